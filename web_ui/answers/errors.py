"""What went wrong."""

from pydantic import BaseModel


class Reason(BaseModel):
    """A code for programs, a sentence for the operator."""

    code: str
    message: str


class Error(BaseModel):
    """Why not."""

    error: Reason
