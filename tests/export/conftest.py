"""The shared test vectors: one tuning and one recording on which every target must answer as the textbook does."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, replace

import numpy as np
import pytest

from kalscope import ChannelTuning, Recording, Tuning, kalman_filter
from kalscope.filtering.kernels import transition

ROWS = 400
MISSING = math.nan


@dataclass(frozen=True)
class Shared:
    """What all targets are checked on; arrays have shape (ROWS, channels), in the order of `tuning.channels`."""

    tuning: Tuning
    recording: Recording
    x: np.ndarray
    """Filtered values of the textbook oracle below."""
    k: np.ndarray
    """Its gains."""

    def only(self, names: list[str]) -> Shared:
        """The same with some of the channels."""
        keep = [self.recording.index(name) for name in names]
        channels = tuple(self.tuning.channels[i] for i in keep)
        values = self.recording.values[:, keep]
        recording = Recording(self.recording.time, tuple(names), ("",) * len(keep), values, 0.01)
        return Shared(Tuning(channels, sample_period=0.01), recording, self.x[:, keep], self.k[:, keep])

    @property
    def names(self) -> list[str]:
        return list(self.recording.names)


def textbook(channel, z):
    """x and k after each sample: the five lines, a missing sample, the three starts and the gate.

    A second state is the velocity v, whose variance is w and its covariance with x is g: without momentum all 0.
    """
    e, f, q11, q12, q22, w = 0.0, 0.0, channel.q, 0.0, 0.0, 0.0
    if channel.momentum:
        e, f, q11, q12, q22 = transition(1.0, channel.q, channel.momentum)
        w = 0.5 * channel.q / channel.momentum
    x, v = (MISSING if channel.x0 is None else channel.x0), 0.0
    p, g = (math.inf if channel.p0 is None else channel.p0), 0.0
    refused, answers = 0, []
    for sample in z:
        x, v = x + f * v, e * v
        p, g, w = p + f * (2.0 * g + f * w) + q11, e * (g + f * w) + q12, e * e * w + q22
        k, s = 0.0, p + channel.r
        if math.isnan(sample):
            pass
        elif math.isinf(p):
            x, p, g, k, refused = sample, channel.r, 0.0, 1.0, 0
        elif channel.gate is not None and (sample - x) * (sample - x) > channel.gate * s and refused < 5:
            refused += 1
        else:
            k, ell = p / s, g / s
            x, v = (sample, v) if math.isnan(x) else (x + k * (sample - x), v + ell * (sample - x))
            p, g, w, refused = k * channel.r, ell * channel.r, w - ell * g, 0
        answers.append((x, k))
    return np.array(answers)


def own_answer(channel, samples):
    """Filtered value and gain after each sample, by Kalscope."""
    run = kalman_filter(np.array(samples), channel.params)
    return np.column_stack((run.x, run.k))


def noisy(seed, level=0.0, sigma=1.0):
    rng = random.Random(seed)
    return [level + rng.gauss(0.0, sigma) for _ in range(ROWS)]


def channels_and_samples():
    """Each channel is one difficulty."""
    holes = noisy(2, 20.0)
    for i in (0, 1, 50, 51, 52, *range(100, 140), ROWS - 1):
        holes[i] = MISSING
    jump = [*noisy(3)[:200], *noisy(3, 50.0)[200:]]
    spikes = noisy(4)
    for i in (30, 31, 90, *range(150, 162), 300):
        spikes[i] += 40.0
    gaps_and_spikes = [MISSING if i in range(152, 155) else z for i, z in enumerate(spikes)]
    late = [MISSING] * 7 + noisy(5, -3.0)[7:]
    return [
        (ChannelTuning("diffuse", "V", 0.01, 1.0), noisy(1)),
        (ChannelTuning("holes", "degC", 0.125, 1.0), holes),
        (ChannelTuning("level jump", "V", 0.001, 0.5, 1.0, 0.0), jump),
        (ChannelTuning("gate", "V", 0.01, 1.0, gate=9.0), spikes),
        (ChannelTuning("gate and holes", "V", 0.01, 1.0, 4.0, 0.5, gate=9.0), gaps_and_spikes),
        (ChannelTuning("first sample", "V", 0.3, 2.0, 5.0), late),
        (ChannelTuning("late diffuse", "V", 0.3, 2.0), late),
        (ChannelTuning("p0 zero", "V", 1.0, 100.0, 0.0, 0.0), noisy(6, sigma=40.0)),
        (ChannelTuning("q zero", "V", 0.0, 25.0, 225.0, 60.0), noisy(7, 50.0, 5.0)),
        (ChannelTuning("r zero", "V", 2.0, 0.0), noisy(8)),
        (ChannelTuning("slow", "V", 1e-9, 3.0), noisy(9)),
        (ChannelTuning("tiny", "V", 1e-14, 1e-12), noisy(10, 1e-5, 1e-6)),
        (ChannelTuning("large", "Pa", 1e8, 1e10), noisy(11, 1e5, 1e5)),
    ]


def extreme_channels():
    """What float32 cannot hold."""
    return [
        (ChannelTuning("minute", "V", 1e-280, 1e-270), noisy(12, 1e-134, 1e-135)),
        (ChannelTuning("subnormal", "V", 5e-324, 1e-310), noisy(13, 0.0, 1e-155)),
        (ChannelTuning("huge", "V", 1e270, 1e280), noisy(14, 1e140, 1e140)),
        (ChannelTuning("huge gate", "V", 1e300, 1e300, gate=4.0), noisy(15, 1e150, 3e150)),
    ]


def channels_with_two_speeds():
    """The difficulties that they can have, beside one without."""
    cases = [(one, samples) for one, samples in channels_and_samples() if one.r and one.q and not one.gate]
    spikes, steps = (samples for one, samples in channels_and_samples() if one.name in ("gate", "level jump"))
    kinds = [(f"{one.name} twice", 10.0 ** (i + 1), 0.0 if i % 2 else 0.01) for i, (one, _) in enumerate(cases)]
    return cases[:1] + [
        (replace(one, name=name, fast=fast, spikes=share), samples if i else (*spikes[:200], *steps[200:]))
        for i, ((one, samples), (name, fast, share)) in enumerate(zip(cases, kinds, strict=True))
    ]


MOMENTA = (20.0, 0.3, 1e5, 3.0, 100.0)


def channels_with_momentum():
    """The same difficulties with momenta from a third of a sample on, among some without."""
    cases = channels_and_samples()
    return cases[:2] + [
        (replace(channel, name=f"{channel.name} on", momentum=MOMENTA[i % len(MOMENTA)]), samples)
        for i, (channel, samples) in enumerate(cases)
    ]


@pytest.fixture(scope="session")
def shared():
    """Every case of the shared vectors without momentum."""
    return answered(channels_and_samples() + extreme_channels())


@pytest.fixture(scope="session")
def shared_with_momentum():
    """The cases with momentum."""
    return answered(channels_with_momentum())


@pytest.fixture(scope="session")
def shared_with_two_speeds():
    """The cases with two speeds; `tests/filtering/test_two_speeds.py` has their textbook."""
    return answered(channels_with_two_speeds())


@pytest.fixture(scope="session", params=["shared", "shared_with_momentum", "shared_with_two_speeds"])
def either(request):
    """For targets that know all: the cases without momentum, with it, and with two speeds."""
    return request.getfixturevalue(request.param)


def answered(cases):
    """The cases with what the textbook answers."""
    channels = tuple(channel for channel, _ in cases)
    z = np.array([samples for _, samples in cases]).T
    answers = np.array(
        [textbook(one, samples) if one.fast is None else own_answer(one, samples) for one, samples in cases]
    )
    names = tuple(channel.name for channel in channels)
    recording = Recording(np.arange(ROWS) * 0.01, names, ("",) * len(names), z, 0.01)
    return Shared(Tuning(channels, sample_period=0.01), recording, answers[..., 0].T, answers[..., 1].T)


@pytest.fixture(scope="session")
def shared_float32(shared):
    """The cases whose numbers float32 holds."""
    return shared.only([channel.name for channel, _ in channels_and_samples()])
