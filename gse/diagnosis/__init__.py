"""Diagnosis: causes of the errors of a session, found by models that compete, as findings with size and next step."""
