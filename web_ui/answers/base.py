"""What every answer is."""

from pydantic import BaseModel, ConfigDict


class Answer(BaseModel):
    """A JSON object; fields that are not named here may be in it."""

    model_config = ConfigDict(extra="allow")
