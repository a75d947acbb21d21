"""
Times and errors of the slider solvers, side by side with those a user could take instead.

On the 12 signals of figure 12 and both friction models, from rest:

* closed form: all drive periods integrated, no steady state looked for;
* power series: the solver for springs, stops and Stribeck friction, on the same cases;
* stepping: the virtual plant's solver at 1 MS/s, all outputs included;
* heyoka: `taylor_adaptive` with terminal events, at its default tolerance, that of rounding, and at
  1e-7, which gives about the accuracy of stepping;
* SciPy: `solve_ivp` with DOP853 and events, rtol 1e-12.

One process, one thread, the solvers taken in turn in each round; medians of CPU time over the
rounds. Errors are those of the mean velocity over the last quarter of the periods that the solver
went through, relative to the closed form over the same periods; the power series, which shares
nothing with it but the equations, stands for the closed form's own error. Compilation is not
counted.

Run: python bench/solvers.py [ROUNDS]
"""

from __future__ import annotations

import importlib.util
import math
import os
import statistics
import sys
import time

import numpy as np

from imotor_ros.core import closed_form, taylor
from imotor_ros.core.friction import CoulombFriction, VelocityDependentFriction
from imotor_ros.core.signals import parabolic_sawtooth
from imotor_ros.core.slider import LoadParameters, SliderParameters
from imotor_ros.core.stepping import SliderStepper

SLIDER = SliderParameters()
MASS = SLIDER.mass
FREE = LoadParameters.free()
RATE = 1e6
LAWS = {"model 1": CoulombFriction(), "model 2": VelocityDependentFriction()}
GRID = [(n, f) for n in (2, 3, 4) for f in (2312.5, 4625.0, 9250.0, 18500.0)]

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class ClosedForm:
    name, periods = "closed form", 4000

    def prepare(self, motion, law):
        return motion, law

    def run(self, case):
        motion, law = case
        table = closed_form.simulate(motion, SLIDER, law, periods=self.periods)
        return float(table.mean_velocity[-self.periods // 4 :].mean())


class PowerSeries:
    name, periods = "power series", 400

    def prepare(self, motion, law):
        return motion, law

    def run(self, case):
        motion, law = case
        table = taylor.simulate(motion, SLIDER, law, periods=self.periods)
        return float(table.mean_velocity[-self.periods // 4 :].mean())


class Stepping:
    """The sampled solver; its positions are read at the ends of the window by cubics."""

    name, periods = "stepping", 200

    def prepare(self, motion, law):
        count = math.ceil(self.periods * motion.period * RATE) + 2
        t = np.arange(count) / RATE
        self.samples_per_period = motion.period * RATE
        return motion, law, motion.velocity(t), motion.acceleration(t)

    def run(self, case):
        motion, law, velocity, acceleration = case
        seen = SliderStepper(SLIDER, FREE, law, RATE).process(velocity, acceleration)
        self._seen, self._motion = seen, motion

    def result(self):
        x, v, motion = self._seen.position, self._seen.velocity / RATE, self._motion
        ends = []
        for periods in (self.periods - self.periods // 4, self.periods):
            at = periods * motion.period * RATE
            i = min(int(at), x.size - 2)
            u, rise = at - i, x[i + 1] - x[i]
            bend, twist = 3 * rise - 2 * v[i] - v[i + 1], v[i] + v[i + 1] - 2 * rise
            ends.append(x[i] + u * (v[i] + u * (bend + u * twist)))
        return (ends[1] - ends[0]) / (self.periods // 4 * motion.period)


class Heyoka:
    """Two integrators, sliding and sticking; the terminal events switch between them."""

    periods = 200

    def __init__(self, tolerance=0.0):
        import heyoka

        self.heyoka, self.integrators, self.tolerance = heyoka, {}, tolerance
        self.name = f"heyoka {tolerance:.0e}" if tolerance else "heyoka"

    def _make(self, n):
        hy = self.heyoka
        x, v = hy.make_vars("x", "v")
        omega, sign, force, slope = (hy.par[i] for i in range(4))
        rod, rate = 0.0, 0.0
        for k in range(1, n + 1):
            gain, phase = hy.par[2 + 2 * k], hy.par[3 + 2 * k]
            angle = k * omega * hy.time + phase
            rod = rod + gain * hy.cos(angle)
            rate = rate - gain * k * omega * hy.sin(angle)
        slide = hy.taylor_adaptive(
            [(x, v), (v, (sign * force + slope * (rod - v)) / MASS)],
            [0.0, 0.0], pars=[0.0] * (4 + 2 * n), t_events=[hy.t_event(rod - v)],
            tol=self.tolerance,
        )  # fmt: skip
        stick = hy.taylor_adaptive(
            [(x, v), (v, rate)], [0.0, 0.0], pars=[0.0] * (4 + 2 * n),
            t_events=[hy.t_event(MASS * rate - force), hy.t_event(MASS * rate + force)],
            tol=self.tolerance,
        )  # fmt: skip
        return slide, stick

    def prepare(self, motion, law):
        n = motion.harmonics
        if n not in self.integrators:
            self.integrators[n] = self._make(n)
        omega = 2 * math.pi * motion.fundamental_frequency
        pars = [omega, 1.0, law.numbers.force, law.numbers.slope]
        for k, (a, p) in enumerate(zip(motion.amplitudes, motion.phases, strict=True), 1):
            pars += [a * k * omega, p]
        for each in self.integrators[n]:
            each.pars[:] = pars
        return motion, law, *self.integrators[n]

    def run(self, case):
        motion, law, slide, stick = case
        force = law.numbers.force
        end, quarter = (
            self.periods * motion.period,
            (self.periods - self.periods // 4) * motion.period,
        )
        slide.time, slide.state[:] = 0.0, 0.0
        slide.reset_cooldowns()
        slide.pars[1] = 1.0 if motion.velocity(0.0) > 0.0 else -1.0
        active, at_quarter = slide, None
        while True:
            target = quarter if at_quarter is None else end
            active.propagate_until(target)
            t = active.time
            if t >= target:
                if at_quarter is not None:
                    return (active.state[0] - at_quarter) / (end - quarter)
                at_quarter = active.state[0]
                continue
            rate = float(motion.acceleration(t))
            if active is slide:
                if abs(MASS * rate) > force:
                    slide.pars[1] = math.copysign(1.0, rate)
                else:
                    stick.time, stick.state[:] = t, slide.state
                    stick.reset_cooldowns()
                    active = stick
            else:
                # Sliding begins without relative acceleration: a little on, its sign is sure.
                step = 1e-6 * motion.period
                slide.pars[1] = math.copysign(1.0, rate)
                x, v = stick.state
                slide.time = t + step
                slide.state[:] = x + step * v, v + step * slide.pars[1] * force / MASS
                slide.reset_cooldowns()
                active = slide


class Scipy:
    name, periods = "SciPy DOP853", 4

    def prepare(self, motion, law):
        from scipy.integrate import solve_ivp

        self.solve_ivp = solve_ivp
        return motion, law

    def run(self, case):
        motion, law = case
        k = np.arange(1, motion.harmonics + 1)
        omega = 2 * math.pi * motion.fundamental_frequency
        terms = [
            (j * omega, a * j * omega, p)
            for j, a, p in zip(k.tolist(), motion.amplitudes, motion.phases, strict=True)
        ]
        force, slope = law.numbers.force, law.numbers.slope

        def rod(t):
            return sum(g * math.cos(w * t + p) for w, g, p in terms)

        def need(t):
            return MASS * sum(-g * w * math.sin(w * t + p) for w, g, p in terms)

        end = self.periods * motion.period
        quarter = end - self.periods // 4 * motion.period
        t, x, v, x_quarter = 0.0, 0.0, 0.0, None
        sign = 1.0 if rod(0.0) > 0.0 else -1.0
        while t < end:
            target = quarter if x_quarter is None else end
            if sign:

                def slide(t, y, sign=sign):
                    return (y[1], (sign * force + slope * (rod(t) - y[1])) / MASS)

                def events(t, y):
                    return rod(t) - y[1]

                events.direction = -sign
            else:

                def slide(t, y):
                    return (y[1], need(t) / MASS)

                def events(t, _y):
                    return force - abs(need(t))

                events.direction = -1.0
            events.terminal = True
            found = self.solve_ivp(
                slide, (t, target), (x, v), method="DOP853", rtol=1e-12, atol=1e-15, events=events,
                max_step=motion.period / 128,  # longer steps miss pairs of events
            )  # fmt: skip
            t, (x, v) = float(found.t[-1]), found.y[:, -1]
            if found.status == 1:
                stays = sign and abs(need(t)) <= force
                sign = 0.0 if stays else math.copysign(1.0, need(t))
                if not stays and abs(abs(need(t)) - force) < 1e-9:
                    t, x, v = t + 1e-9 * motion.period, x, v
            elif x_quarter is None:
                x_quarter = x
        return (x - x_quarter) / (end - quarter)


def _solvers():
    found = [ClosedForm(), PowerSeries(), Stepping()]
    for name, makers in (("heyoka", (Heyoka, lambda: Heyoka(1e-7))), ("scipy", (Scipy,))):
        if importlib.util.find_spec(name) is None:
            print(f"{name}: not installed, skipped")
        else:
            found += [make() for make in makers]
    return found


def _timed(solver, case):
    start = time.process_time()
    mean = solver.run(case)
    seconds = time.process_time() - start
    return seconds / solver.periods, mean if mean is not None else solver.result()


def main(rounds: int) -> None:
    solvers = _solvers()
    names = [solver.name for solver in solvers]
    times = {name: [] for name in names}
    errors = {name: [] for name in names}
    per_sample = []
    print("CPU time per drive period (us) and relative error of the mean velocity")
    print(f"{'case':>22}" + "".join(f"{name:>20}" for name in names))
    for label, law in LAWS.items():
        for n, frequency in GRID:
            motion = parabolic_sawtooth(n, maximum_frequency=frequency)
            exact = closed_form.simulate(motion, SLIDER, law, periods=4000).mean_velocity
            cases = [solver.prepare(motion, law) for solver in solvers]
            seconds = {name: [] for name in names}
            for _ in range(rounds):
                for solver, case in zip(solvers, cases, strict=True):
                    spent, mean = _timed(solver, case)
                    seconds[solver.name].append(spent)
                    last = exact[solver.periods - solver.periods // 4 : solver.periods].mean()
                    error = abs(mean / last - 1.0)
                    if solver.name == "stepping":
                        spent_per_sample = spent / solver.samples_per_period
                        per_sample.append(spent_per_sample)
                    if _ == 0:
                        errors[solver.name].append(error)
            row = f"{label} n={n} {frequency:8.1f}"
            for name in names:
                times[name].append(statistics.median(seconds[name]))
                row += f"{times[name][-1] * 1e6:12.2f}{errors[name][-1]:8.0e}"
            print(f"{row}", flush=True)
    print()
    base = statistics.median(times["closed form"])
    print(f"{'':>14}{'median us/period':>18}{'worst':>10}{'ratio':>10}{'worst error':>14}")
    for name in names:
        median = statistics.median(times[name])
        # the closed form is the reference: its error is how far the power series is from it
        error = max(errors["power series" if name == "closed form" else name])
        print(
            f"{name:>14}{median * 1e6:18.3f}{max(times[name]) * 1e6:10.2f}"
            f"{median / base:10.1f}{error:14.0e}"
        )
    cases = np.median(np.array(per_sample).reshape(-1, rounds), axis=1) * 1e9
    print(
        f"\nstepping at {RATE / 1e6:g} MS/s: {np.median(cases):.0f} ns per sample (median), "
        f"{cases.max():.0f} ns in the slowest case"
    )


if __name__ == "__main__":
    pinned = dict.fromkeys(THREADS, "1")
    if pinned.items() - os.environ.items():
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, **pinned})
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
