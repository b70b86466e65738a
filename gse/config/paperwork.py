"""The ``test:`` block of a station file: what a report states beside its figures.

Every key may be left out; a report prints what it misses.
"""

import datetime
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator

from drivers.outside_text import is_plain


def _plain(text: str) -> str:
    if not is_plain(text):
        raise ValueError(f"{text!r:.60} holds a control character")
    return text


Text = Annotated[str, Field(max_length=500), AfterValidator(_plain)]
_MOST = 100
"""Instruments, requirements or deviations: a report is read by people."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, coerce_numbers_to_str=True)


class Instrument(_Section):
    """An instrument that took part, and the day of its last calibration."""

    name: Text
    serial: Text | None = None
    calibrated: datetime.date | None = None


class VerifiedRequirement(_Section):
    """The requirement that a row verifies, and the verification method."""

    id: Text
    method: Text | None = None


class DocumentedTest(_Section):
    """Who tested what, by which procedure; None where the station file does not say."""

    id: Text | None = None
    report: Text | None = None
    procedure: Text | None = None
    operator: Text | None = None
    witness: Text | None = None
    reviewer: Text | None = None
    approver: Text | None = None
    sensor_serial: Text | None = None
    sensor_firmware: Text | None = None
    instruments: Annotated[tuple[Instrument, ...], Field(max_length=_MOST)] = ()
    requirements: Annotated[dict[Text, VerifiedRequirement], Field(max_length=_MOST)] = {}
    """By the name of the row of the verdict."""
    deviations: Annotated[tuple[Text, ...], Field(max_length=_MOST)] | None = None
    """An empty list states that there are none."""

    @field_validator("requirements", mode="before")
    @classmethod
    def _an_id_alone(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        return {row: given if isinstance(given, dict) else {"id": given} for row, given in value.items()}
