"""What all blocks of typed YAML share: those of the configuration, of drivers, pads and the world.

Unlike `landerd.config` this may be imported by `hw`.
"""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-360, le=360)]  # in degrees


class Section(BaseModel):
    """A block of keys: unknown ones are errors, values never change."""

    model_config = ConfigDict(frozen=True, extra="forbid")
