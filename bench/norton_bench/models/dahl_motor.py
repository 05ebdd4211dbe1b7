"""The torque motor with Dahl friction (paper, section IV.D), in the paper's symbols.

=========  ==============  =====================================================
symbol     unit            meaning
=========  ==============  =====================================================
e_c        command unit    command (the paper's is a voltage)
i          A               motor current
Ka         A/command       amplifier gain
beta       rad/s           amplifier bandwidth
Km         N m/A           torque constant
Im         kg m^2          rotor inertia
B          N m s/rad       viscous damping
sigma_0    N m/rad         presliding stiffness
sigma_1    N m s/rad       presliding damping
tau_c      N m             Coulomb torque
phi        rad             Dahl state (deflection of the friction contact)
omega      rad/s           shaft velocity
tau_act    N m             torque that the actuator exerts at its port
=========  ==============  =====================================================
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class DahlMotor:
    """Parameters of section IV.D."""

    Ka: float
    beta: float
    Km: float
    Im: float
    B: float
    sigma_0: float
    sigma_1: float
    tau_c: float

    def dahl_rate(self, omega: float, phi: float) -> float:
        """dφ/dt = ω − (σ0/τc) |ω| φ  [rad/s]."""
        return omega - self.sigma_0 / self.tau_c * abs(omega) * phi

    def dahl_torque(self, omega: float, phi: float) -> float:
        """τ_Dahl = σ0 φ + σ1 dφ/dt  [N m]."""
        return self.sigma_0 * phi + self.sigma_1 * self.dahl_rate(omega, phi)

    def current_rate(self, i: float, e_c: float) -> float:
        """di/dt = Ka β e_c − β i  [A/s]."""
        return self.Ka * self.beta * e_c - self.beta * i

    def acceleration(self, i: float, omega: float, phi: float, tau_act: float) -> float:
        """dω/dt = (Km i − τ_act − τ_Dahl − B ω) / Im  [rad/s²] (admittance form: torque in, motion out)."""
        return (self.Km * i - tau_act - self.dahl_torque(omega, phi) - self.B * omega) / self.Im

    def port_torque(self, i: float, omega: float, phi: float, omega_rate: float) -> float:
        """τ_act = Km i − τ_Dahl − B ω − Im dω/dt  [N m] (impedance form: motion in, torque out)."""
        return self.Km * i - self.dahl_torque(omega, phi) - self.B * omega - self.Im * omega_rate

    def source_velocity(self, e_c: float) -> float:
        """ω_N(e_c): the steady free velocity [rad/s], in three branches; single-valued, though not invertible."""
        torque = self.Km * self.Ka * e_c
        if torque > self.tau_c:
            return (torque - self.tau_c) / self.B
        if torque < -self.tau_c:
            return (torque + self.tau_c) / self.B
        return 0.0
