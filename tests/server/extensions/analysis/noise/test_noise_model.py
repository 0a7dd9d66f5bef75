"""Intervals of noise parameters: they hold the truth as often as they state."""

import math
from collections import Counter

import numpy as np

from imuscope.server.extensions.analysis.noise.allan_deviation import allan_curve, averaging_lengths
from imuscope.server.extensions.analysis.noise.noise_model import fit_noise
from tests.server.extensions.analysis.simulated_sensors import flicker_noise

SAMPLES, RATE = 12_000, 100.0


def test_intervals_of_95_percent_hold_the_truth_in_93_to_99() -> None:
    """N, B and K of 200 sensors, of which each has B, K, both or none; those that a curve does not show have limits."""
    fitted, held, limits = Counter[str](), Counter[str](), []
    for seed in range(200):
        draw = np.random.default_rng([seed, 3])
        flicker = 10 ** draw.uniform(-1, 1) * (seed % 2)
        walk = 10 ** draw.uniform(-2, 0.5) * (seed // 2 % 2)
        values = draw.normal(0, math.sqrt(RATE), SAMPLES) + flicker_noise(SAMPLES, flicker, draw)
        values += np.cumsum(draw.normal(0, 1 / math.sqrt(RATE), SAMPLES)) * walk
        model = fit_noise(allan_curve([values], RATE, averaging_lengths(SAMPLES, 8)))
        for name, truth in (("random_walk", 1.0), ("bias_instability", flicker), ("rate_random_walk", walk)):
            parameter = model.parameters[name]
            is_held = parameter.low <= truth <= parameter.high
            if parameter.value:
                fitted[name] += 1
                held[name] += is_held
            else:
                limits.append(is_held)
    assert min(held[name] / fitted[name] for name in fitted) >= 0.93
    assert min(fitted.values()) > 20
    assert 0.93 <= held.total() / fitted.total() <= 0.99
    assert np.mean(limits) > 0.97
