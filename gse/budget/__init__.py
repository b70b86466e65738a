"""The truth uncertainty budget: its inputs, and what each leaves open in the truth of a session."""
