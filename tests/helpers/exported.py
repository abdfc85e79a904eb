"""Where the student that ships lies."""

from romgrl.provenance.shipped import PLACE

SHIPPED = PLACE / "student"
