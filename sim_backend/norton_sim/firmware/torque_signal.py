"""What a torque sensor measures, and how a test makes it lie."""

from norton_sim.plant import Plant


class TorqueSignal:
    """The plant's torque sensor, which can be made to stand still or to give a value of the test's choosing."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._forced_nm: float | None = None

    def measure_nm(self) -> float:
        """One measurement now, in the sensor's own sense."""
        return self._plant.sensor_torque_nm() if self._forced_nm is None else self._forced_nm

    def freeze(self) -> None:
        """From now on give the value of this instant."""
        self._forced_nm = self.measure_nm()

    def force(self, torque_nm: float) -> None:
        """From now on give ``torque_nm``, which may be NaN."""
        self._forced_nm = torque_nm
