"""The servo loop as one Drake LeafSystem in Python: seven states (position and velocity of the rigid body and of two modes,
thrust), the controller as a periodic event, slip and reversal by two witness functions. Elements in stick follow the
position, so friction is affine in position and velocity between events.

    python3 drake_loop.py SCENARIOS.json

The file is the one that tribode_benchmarks writes. Prints scenario,method,us_per_sample,error_m,events; the times are the
process's, of one run.
"""
import json
import math
import sys
import time

try:
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
    from pydrake.systems.framework import EventStatus, LeafSystem, UnrestrictedUpdateEvent, WitnessFunctionDirection
except ImportError as error:
    sys.exit(f"drake_loop.py: skipped, {error}")


class Loop:
    """The sampled part, one call per sample: position in, thrust out; one whole sample of delay on either side."""

    def __init__(self, scenario):
        self.excitation, self.loop, self.ts = scenario["excitation"], scenario["loop"], scenario["sample_time"]
        self.detected = self.integral = self.last_error = self.waiting = 0.0
        self.k = 0

    def thrust(self, position):
        excitation = self.excitation[self.k]
        self.k += 1
        if not self.loop:
            return excitation
        error, step = -self.detected, self.loop["encoder_resolution"]
        self.detected = step * math.floor(position / step + 0.5)
        self.integral += self.loop["ki"] * self.ts * error
        acting = self.waiting
        self.waiting = (
            self.loop["kp"] * error + self.integral + self.loop["kd"] * (error - self.last_error) / self.ts + excitation
        )
        self.last_error = error
        return acting


class Servo(LeafSystem):
    def __init__(self, scenario):
        LeafSystem.__init__(self)
        self.loop = Loop(scenario)
        self.bodies = [(scenario["rigid_gain"], 0.0, 0.0)]
        for gain, freq_hz, zeta in scenario["modes"]:
            omega = 2 * math.pi * freq_hz
            self.bodies.append((gain, 2 * zeta * omega, omega * omega))
        self.lag = 2 * math.pi * scenario["lag_hz"]
        self.viscous = scenario["viscous"]
        self.stiffness_of, self.force_of, self.damping_of = zip(*scenario["elements"])
        self.limit = [f / k for k, f, _ in scenario["elements"]]
        self.z = [0.0] * len(self.limit)
        self.slips = [False] * len(self.limit)
        self.direction, self.reference, self.y0, self.events = 1.0, 0.0, 0.0, 0
        self.catch_up(0.0)
        self.positions = []
        self.DeclareContinuousState(7)
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=scenario["sample_time"], offset_sec=0.0, update=self.on_sample
        )
        falling = WitnessFunctionDirection.kPositiveThenNonPositive
        self.witnesses = [
            self.MakeWitnessFunction("reversal", falling, self.velocity_left, UnrestrictedUpdateEvent(self.on_reversal)),
            self.MakeWitnessFunction("slip", falling, self.room_left, UnrestrictedUpdateEvent(self.on_slip)),
        ]

    @staticmethod
    def values(context):
        return context.get_continuous_state_vector().CopyToVector().tolist()

    def velocity_left(self, context):
        x = self.values(context)
        # A reversal leaves the velocity at zero; the offset keeps it from falling again at once.
        return self.direction * (x[1] + x[3] + x[5]) + 1e-12

    def room_left(self, context):
        x = self.values(context)
        return self.room - self.direction * (x[0] + x[2] + x[4] - self.y0)

    def DoGetWitnessFunctions(self, context):
        return self.witnesses

    def DoCalcTimeDerivatives(self, context, derivatives):
        x = self.values(context)
        y, v = x[0] + x[2] + x[4], x[1] + x[3] + x[5]
        friction = self.force + self.stiffness * (y - self.y0) + self.damping * v
        effective = (x[6] if self.lag > 0 else self.reference) - friction
        slope = []
        for j, (gain, damping, stiffness) in enumerate(self.bodies):
            slope += [x[2 * j + 1], gain * effective - damping * x[2 * j + 1] - stiffness * x[2 * j]]
        derivatives.SetFromVector(slope + [self.lag * (self.reference - x[6])])

    def on_sample(self, context, state):
        x = self.values(context)
        self.positions.append(x[0] + x[2] + x[4])
        if self.loop.k < len(self.loop.excitation):
            self.reference = self.loop.thrust(self.positions[-1])
        return EventStatus.Succeeded()

    def on_reversal(self, context, event, state):
        x = self.values(context)
        self.catch_up(x[0] + x[2] + x[4])
        self.slips = [False] * len(self.slips)
        self.direction = -self.direction
        self.events += 1
        self.refresh()
        return EventStatus.Succeeded()

    def on_slip(self, context, event, state):
        x = self.values(context)
        self.catch_up(x[0] + x[2] + x[4], slack=1e-9)
        self.events += 1
        return EventStatus.Succeeded()

    def catch_up(self, y, slack=0.0):
        """The elements in stick follow to y; those at their limit go onto it and slip."""
        for i, limit in enumerate(self.limit):
            if not self.slips[i]:
                self.z[i] += y - self.y0
                if self.direction * self.z[i] >= limit * (1 - slack):
                    self.z[i] = self.direction * limit
                    self.slips[i] = True
        self.y0 = y
        self.refresh()

    def refresh(self):
        stick = [i for i, slips in enumerate(self.slips) if not slips]
        self.force = sum(k * z for k, z in zip(self.stiffness_of, self.z))
        self.stiffness = sum(self.stiffness_of[i] for i in stick)
        self.damping = self.viscous + sum(self.damping_of[i] for i in stick)
        self.room = min((self.limit[i] - self.direction * self.z[i] for i in stick), default=math.inf)


def run(scenario, accuracy):
    servo = Servo(scenario)
    simulator = Simulator(servo)
    ResetIntegratorFromFlags(simulator, "runge_kutta5", 0.1)
    simulator.get_mutable_integrator().set_target_accuracy(accuracy)
    simulator.get_mutable_context().SetAccuracy(accuracy)
    simulator.Initialize()
    # Beyond the last sample by rounding only.
    simulator.AdvanceTo(scenario["sample_time"] * len(scenario["excitation"]) + 1e-9)
    return servo


def main():
    with open(sys.argv[1]) as file:
        scenarios = json.load(file)
    for scenario in scenarios:
        for accuracy in (1e-4, 1e-6):
            start = time.process_time()
            servo = run(scenario, accuracy)
            us = 1e6 * (time.process_time() - start) / len(scenario["excitation"])
            reference = scenario["position"]
            error = max(abs(a - b) for a, b in zip(servo.positions, reference))
            if len(servo.positions) < len(reference):
                error = math.nan
            print(f"{scenario['name']},Drake RK5 {accuracy:g},{us},{error},{servo.events}", flush=True)


main()
