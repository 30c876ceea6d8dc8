"""Contact geometry of the feet."""

from typing import Literal

__all__ = ["FootContacts"]

FootContacts = Literal["spheres", "capsules"]
"""Four spheres a foot, as in Unitree's description, or capsules along the outline of the sole."""
