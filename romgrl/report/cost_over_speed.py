"""The cost of transport of a gait over speed: where it is least, and whether it is a U."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd

from romgrl.gait.features import Floats


class CostOverSpeed(NamedTuple):
    """Cost of transport (C,) of the cells of a gait by speed (C,), m/s."""

    speeds: Floats
    costs: Floats

    @property
    def cheapest(self) -> int:
        """Number of the cell of the least cost."""
        return int(self.costs.argmin())

    @property
    def is_u(self) -> bool:
        """Whether it costs more at both ends."""
        return 0 < self.cheapest < len(self.costs) - 1


def cost_over_speed(rows: pd.DataFrame) -> CostOverSpeed:
    """Of a walker's rows of grid.csv of one gait: of its cells in which no episode falls and the cost is known.

    What walks up to a fall costs something else, and the ends of a range, where falls are, make a U.
    """
    counted = rows[np.isfinite(rows.cost_of_transport) & (rows.falls == 0)].sort_values("speed_m_per_s")
    return CostOverSpeed(counted.speed_m_per_s.to_numpy(float), counted.cost_of_transport.to_numpy(float))
