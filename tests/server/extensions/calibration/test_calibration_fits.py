"""Fits of calibrations: simulated sensors with known errors, a slow oracle, and data that determine no answer."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize

from imuscope.protocols import rotations
from imuscope.protocols.arrays import Floats
from imuscope.protocols.simulator import trajectory
from imuscope.protocols.simulator.setups import GYRO_BIAS, HARD_IRON, MOTIONS, SOFT_IRON, SensorSetup
from imuscope.server.extensions.analysis.signals.stillness import step_means, stillness
from imuscope.server.extensions.analysis.signals.triads import NO_SAMPLES, Samples
from imuscope.server.extensions.calibration.directions import (
    CELLS,
    CELLS_PER_RING,
    CENTRES,
    HALF,
    cells_of,
    missing_axes,
)
from imuscope.server.extensions.calibration.gyroscope import NEEDED_S, gyroscope_bias
from imuscope.server.extensions.calibration.magnetometer import fit_ellipsoid, magnetometer_iron, provisional_centre
from imuscope.server.extensions.calibration.report import CalibrationReport
from tests.server.extensions.analysis.simulated_sensors import flicker_noise
from tests.support.each_row import each_row

START = 1_760_000_000.0
RATE = 100.0
FIELD = 48.0


def sampled(values: Any, rate: float = RATE) -> Samples:
    return Samples(START + np.arange(len(values)) / rate, np.asarray(values, np.float64))


def on_a_sphere(n: int, random: np.random.Generator) -> Floats:
    result: Floats = random.normal(size=(n, 3))
    return result / np.linalg.norm(result, axis=1, keepdims=True)


# ── directions ───────────────────────────────────────────────────────────────────────────────────────────────────────


def test_cells_have_the_same_area_and_contain_their_centres() -> None:
    assert (cells_of(CENTRES) == np.arange(CELLS)).all()
    counts = np.bincount(cells_of(on_a_sphere(480_000, np.random.default_rng(1))), minlength=CELLS)
    assert len(counts) == CELLS == 2 * HALF == 2 * sum(CELLS_PER_RING)
    assert counts.min() > 9_500
    assert counts.max() < 10_500


def test_axes_that_were_not_seen_are_named() -> None:
    upper = np.arange(CELLS) < HALF
    assert missing_axes(upper) == ["−z"]
    assert missing_axes(np.zeros(CELLS, np.bool_)) == ["+x", "−x", "+y", "−y", "+z", "−z"]
    assert missing_axes(np.ones(CELLS, np.bool_)) == []
    assert missing_axes(CENTRES[:, 0] > 0) == ["−x"]


# ── magnetometer ─────────────────────────────────────────────────────────────────────────────────────────────────────

SHARES = st.floats(-0.25, 0.25)


@given(
    seed=st.integers(0, 2**32),
    centre=st.tuples(*[st.floats(-200, 200)] * 3),
    shape=st.tuples(*[SHARES] * 6),
    noise=st.floats(0.02, 1.0),
)
def test_hard_and_soft_iron_are_found_within_their_uncertainty(
    seed: int, centre: tuple[float, ...], shape: tuple[float, ...], noise: float
) -> None:
    random = np.random.default_rng(seed)
    a, b, c, d, e, f = shape
    distortion = np.eye(3) + np.array([[a, d / 2, e / 2], [d / 2, b, f / 2], [e / 2, f / 2, c]])
    measured = FIELD * on_a_sphere(3000, random) @ distortion + centre + random.normal(scale=noise, size=(3000, 3))
    report = magnetometer_iron(sampled(measured), "µT", FIELD)
    assert report.refusal is None
    assert report.correction is not None
    bias, sigma = np.array(report.correction.bias), np.array(report.correction.bias_uncertainty)
    assert (np.abs(bias - centre) < 5 * sigma + 0.05 * noise**2).all()
    assert sigma.max() < noise
    truth = np.linalg.inv(distortion)
    bound = 5 * report.correction.matrix_uncertainty + 2 * (noise / FIELD) ** 2  # noise makes an ellipsoid look larger
    assert np.abs(np.array(report.correction.matrix) - truth).max() < bound
    figures = {one.name: one.value for one in report.figures}
    low, high = np.linalg.eigvalsh(truth)[[0, -1]]  # the correction stretches the noise, too
    assert 0.8 * noise * low < figures["residual_after"] < 1.2 * noise * high


def test_the_fit_is_the_one_of_a_general_optimiser() -> None:
    random = np.random.default_rng(3)
    away = on_a_sphere(400, random)
    away = away[np.abs(away[:, 2]) < 0.8]
    measured = away * [40.0, 50.0, 60.0] + [10.0, -20.0, 5.0] + random.normal(scale=2.0, size=away.shape)
    result = fit_ellipsoid(sampled(measured))
    assert result is not None

    def residuals(p: Floats) -> Floats:
        shape = np.array([[p[3], p[4], p[5]], [p[4], p[6], p[7]], [p[5], p[7], p[8]]]) / 50
        norm: Floats = np.linalg.norm((measured - p[:3]) @ shape, axis=1) - 1
        return norm

    slow = optimize.least_squares(residuals, [0, 0, 0, 1, 0, 0, 1, 0, 1], xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    assert result.centre == pytest.approx(slow[:3], abs=1e-4)
    shape = [result.shape[i, j] * 50 for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    assert shape == pytest.approx(slow[3:], abs=1e-5)


def test_the_scatter_of_fits_is_the_uncertainty_that_they_state() -> None:
    results = []
    stated = []
    for seed in range(60):
        random = np.random.default_rng(seed)
        values = FIELD * on_a_sphere(400, random) + random.normal(scale=1.0, size=(400, 3))
        fit = fit_ellipsoid(sampled(values))
        assert fit is not None
        results.append(np.concatenate((fit.centre, fit.shape[np.triu_indices(3)])))
        stated.append(np.sqrt(np.diagonal(fit.covariance)))
    ratio = np.std(results, axis=0) / np.mean(stated, axis=0)
    assert ratio.max() < 1.3
    assert ratio.min() > 0.4


def test_the_iron_of_a_field_that_steps_is_within_its_interval() -> None:
    """Regression: where the field grew by 1 % halfway, intervals of 95 % held 85 % of the biases."""
    held = []
    for seed in range(40):
        draw = np.random.default_rng(seed)
        distortion = np.eye(3) + 0.05 * draw.uniform(-1, 1, (3, 3))
        distortion = (distortion + distortion.T) / 2
        t = np.arange(1500) / 50
        height = 2 * np.abs((t * draw.uniform(0.1, 0.3) + draw.random()) % 1 * 2 - 1) - 1
        angle, flat = draw.uniform(2, 4) * t, np.sqrt(1 - height**2)
        away = np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1)
        strength = np.where(np.arange(1500) < 750, FIELD, FIELD * (1 + 0.01 * (seed % 2)))
        bias = draw.uniform(-30, 30, 3)
        measured = strength[:, None] * away @ distortion + bias + draw.normal(0, 0.3, (1500, 3))
        correction = magnetometer_iron(sampled(measured, 50.0), "µT", FIELD).correction
        if correction is not None:
            held += (np.abs(np.array(correction.bias) - bias) < 1.96 * np.array(correction.bias_uncertainty)).tolist()
    assert len(held) > 100
    assert 0.93 <= np.mean(held) <= 0.99


def test_a_turn_about_one_axis_is_refused_and_the_missing_axes_are_named() -> None:
    angle = np.linspace(0, 40 * np.pi, 6000)
    for height in (0.0, 0.5, 0.87):
        flat = np.sqrt(1 - height**2)
        ring = np.stack([flat * np.cos(angle), flat * np.sin(angle), np.full(len(angle), height)], axis=1)
        noise = np.random.default_rng(1).normal(scale=0.3, size=ring.shape)
        report = magnetometer_iron(sampled(FIELD * ring + noise), "µT")
        assert report.refusal is not None, height
        assert report.correction is None
        assert "−z" in report.refusal.hint
        assert report.progress < 1


@each_row("degrees", [10, 30, 60, 90])
def test_a_cap_of_directions_is_refused(degrees: float) -> None:
    away = on_a_sphere(60_000, np.random.default_rng(2))
    away = away[away[:, 0] > np.cos(np.radians(degrees))][:4000]
    noise = np.random.default_rng(1).normal(scale=0.3, size=away.shape)
    report = magnetometer_iron(sampled(FIELD * away + [15, -30, 10] + noise), "µT")
    assert report.refusal is not None
    assert "−x" in report.refusal.hint


def test_a_field_that_changes_is_refused() -> None:
    random = np.random.default_rng(4)
    strength = np.where(np.arange(4000) < 2000, 48.0, 75.0)
    report = magnetometer_iron(sampled(strength[:, None] * on_a_sphere(4000, random)), "µT")
    assert report.refusal is not None
    assert "changed" in report.refusal.message


def test_few_directions_do_not_invent_a_centre() -> None:
    away = on_a_sphere(60_000, np.random.default_rng(5))
    away = away[away[:, 2] > np.cos(np.radians(15))][:500]
    assert np.linalg.norm(provisional_centre(FIELD * away)) < 0.35 * FIELD
    everywhere = FIELD * on_a_sphere(500, np.random.default_rng(6)) + [100.0, 0, 0]
    assert provisional_centre(everywhere) == pytest.approx([100, 0, 0], abs=5)


def test_a_rest_does_not_outvote_a_turn() -> None:
    random = np.random.default_rng(7)
    turned = FIELD * on_a_sphere(3000, random) * [1.1, 1, 0.9] + [5, 6, 7]
    still = np.tile(turned[-1] + [1.0, 1.0, 1.0], (20_000, 1))  # beside iron, for a while
    report = magnetometer_iron(
        sampled(np.concatenate((turned, still)) + random.normal(scale=0.2, size=(23_000, 3))), "µT"
    )
    assert report.correction is not None
    assert report.correction.bias == pytest.approx([5, 6, 7], abs=0.3)


def test_no_samples_are_refused_in_words() -> None:
    for report in (magnetometer_iron(NO_SAMPLES, "µT"), gyroscope_bias(NO_SAMPLES)):
        assert report.refusal is not None
        assert report.refusal.message.endswith(".")
        assert report.refusal.hint
        assert report.progress == 0


# ── gyroscope ────────────────────────────────────────────────────────────────────────────────────────────────────────


@given(
    seed=st.integers(0, 2**32),
    bias=st.tuples(*[st.floats(-3, 3)] * 3),
    noise=st.floats(0.005, 0.6),
    rate=st.sampled_from([20.0, 100.0, 400.0]),
    seconds=st.floats(14, 60),
)
def test_the_bias_is_found_within_its_uncertainty(
    seed: int, bias: tuple[float, ...], noise: float, rate: float, seconds: float
) -> None:
    random = np.random.default_rng(seed)
    n = int(seconds * rate)
    scale = noise * np.sqrt(rate / 100)
    report = gyroscope_bias(sampled(random.normal(scale=scale, size=(n, 3)) + bias, rate))
    if report.rest is not None and report.rest.seconds < NEEDED_S:  # noise that looks like motion
        # Means of a second that differ by 0.15 °/s: 5.3 standard deviations at a density of 0.02 °/s/√Hz.
        assert scale / np.sqrt(rate) > 0.02
        return
    assert report.correction is not None
    sigma = np.array(report.correction.bias_uncertainty)
    assert (np.abs(np.array(report.correction.bias) - bias) < 6 * sigma).all()
    assert sigma.max() < 4 * scale / np.sqrt(0.6 * n)
    assert report.correction.matrix == np.eye(3).tolist()


@each_row(
    ("degrees", "words"),
    [
        ([31.0, 31.2, 31.1], "Valid near 31 °C: the bias changes with temperature."),
        ([25.0, 27.0, 31.0], "The temperature changed by 6.0 °C in the rest. Let the sensor warm up and repeat."),
        ([], "The temperature is unknown. The bias changes with it: repeat this when the sensor is warmer."),
    ],
)
def test_the_temperature_of_a_bias_is_reported(degrees: list[float], words: str) -> None:
    turn = sampled(np.random.default_rng(8).normal(scale=0.05, size=(6000, 3)))
    inside = np.linspace(turn.time[1000], turn.time[-1000], len(degrees))
    warmth = np.column_stack([degrees] * 3) if degrees else np.empty((0, 3))
    report = gyroscope_bias(turn, temperature=Samples(inside, warmth))
    assert words in report.notes
    assert [one.name for one in report.figures if one.name == "temperature"] == ["temperature"] * bool(degrees)


def test_biases_of_200_gyroscopes_are_within_their_intervals() -> None:
    """White noise, and for half of them flicker."""
    held = []
    for seed in range(200):
        draw = np.random.default_rng(seed)
        n = 2 * round(50 * draw.uniform(12, 60))
        bias, flicker = draw.uniform(-1, 1, 3), 0.002 * (seed % 2)
        noise = np.stack([flicker_noise(n, flicker, draw) for _ in range(3)], axis=1) + draw.normal(0, 0.05, (n, 3))
        correction = gyroscope_bias(sampled(bias + noise)).correction
        assert correction is not None
        held += (np.abs(np.array(correction.bias) - bias) < 1.96 * np.array(correction.bias_uncertainty)).tolist()
    assert 0.93 <= np.mean(held) <= 0.99


def on_a_table(rate: float, seconds: float = 60.0, *, field: bool) -> CalibrationReport:
    """A level sensor with a bias of 0.03 °/s, on a table that turns about the vertical."""
    draw = np.random.default_rng(1)
    t = np.arange(0, seconds, 1 / RATE)
    turn = draw.normal([0.06, -0.1, 0.03 + rate], 0.05, (len(t), 3))
    angle = np.radians(rate * t)
    north = np.stack([20 * np.cos(angle), -20 * np.sin(angle), np.full(len(t), -43.0)], axis=1)
    force = draw.normal([0, 0, 9.81], 0.01, (len(t), 3))
    noisy = sampled(north + draw.normal([30.0, 10, -5], 0.3, (len(t), 3)))
    return gyroscope_bias(sampled(turn), sampled(force), NO_SAMPLES, noisy if field else NO_SAMPLES)


def test_a_turn_about_the_vertical_is_no_bias_with_an_uncertainty_alone() -> None:
    """Regression: a table that turned by 3 °/s was a bias of 3.0285 ± 0.00035 °/s, without a word."""
    words = (
        "any steady turn about the vertical, which no other sensor here excludes: ± holds only for a sensor at rest."
    )
    for rate in (0.0, 3.0):
        correction = on_a_table(rate, field=False).correction
        assert correction is not None
        assert correction.presupposes.endswith(words)
    for rate in (0.3, 3.0, -6.0):
        refusal = on_a_table(rate, field=True).refusal
        assert refusal is not None
        assert refusal.message.startswith("The sensor turns: the direction of the magnetic field changes by ")
    proven = on_a_table(0.0, field=True).correction
    assert proven is not None
    assert proven.presupposes == "The bias contains the turn of the Earth, up to 0.004 °/s."
    alone = gyroscope_bias(sampled(np.random.default_rng(1).normal(0.5, 0.05, (3000, 3)))).correction
    assert alone is not None
    assert "any steady turn, which no other sensor here excludes" in alone.presupposes


def test_a_moment_is_no_rest() -> None:
    turn = sampled(np.random.default_rng(8).normal(scale=0.05, size=(40, 3)))
    report = gyroscope_bias(turn)
    assert report.refusal is not None
    assert report.refusal.message.startswith("The longest rest is 0.0 s")


def test_the_longest_rest_counts_and_motion_is_left_out() -> None:
    random = np.random.default_rng(8)
    turn = random.normal(scale=0.05, size=(6000, 3)) + np.array([0.2, -0.3, 0.1])
    turn[2000:2500] += 20 * np.sin(np.arange(500) / 8)[:, None]
    report = gyroscope_bias(sampled(turn))
    assert report.correction is not None
    assert report.rest is not None
    assert report.rest.seconds == pytest.approx(35, abs=1.5)
    assert report.correction.bias == pytest.approx([0.2, -0.3, 0.1], abs=0.01)


def test_a_sensor_in_the_hand_is_refused() -> None:
    t = np.arange(6000) / RATE
    sway = 2 * np.stack([np.sin(2.1 * t), np.cos(1.3 * t), np.sin(0.7 * t)], axis=1)
    report = gyroscope_bias(sampled(sway))
    assert report.refusal is not None
    assert report.rest is not None
    assert not report.rest.is_still
    assert report.rest.motion > 1


def test_a_steady_turn_is_refused() -> None:
    steady = np.tile([0.0, 0.0, 45.0], (4000, 1)) + np.random.default_rng(9).normal(scale=0.05, size=(4000, 3))
    fast = gyroscope_bias(sampled(steady))
    assert fast.refusal is not None
    assert "45.0 °/s" in fast.refusal.message
    # a slow one about a level axis: only the accelerometer sees it
    t = np.arange(4000) / RATE
    slow = np.tile([0.0, 3.0, 0.0], (4000, 1))
    tilt = np.radians(3.0 * t)
    force = 9.8 * np.stack([np.sin(tilt), 0 * t, np.cos(tilt)], axis=1)
    assert gyroscope_bias(sampled(slow)).correction is not None
    observed = gyroscope_bias(sampled(slow), sampled(force))
    assert observed.refusal is not None


def test_a_warming_sensor_is_reported() -> None:
    turn = sampled(np.random.default_rng(1).normal(scale=0.02, size=(3000, 3)))
    warm = sampled(np.tile(np.linspace(20, 24, 3000)[:, None], (1, 3)))
    report = gyroscope_bias(turn, NO_SAMPLES, warm)
    assert any("temperature changed by" in note for note in report.notes)
    assert {one.name: one.value for one in report.figures}["temperature"] == pytest.approx(22, abs=0.2)


def test_slow_noise_makes_the_uncertainty_larger() -> None:
    random = np.random.default_rng(10)
    walk = np.cumsum(random.normal(scale=3e-4, size=(6000, 3)), axis=0)
    white = random.normal(scale=0.05, size=(6000, 3))
    wandering, plain = gyroscope_bias(sampled(walk + white)), gyroscope_bias(sampled(white))
    assert wandering.correction is not None
    assert plain.correction is not None
    assert max(wandering.correction.bias_uncertainty) > 3 * max(plain.correction.bias_uncertainty)


def test_rest_is_found_to_a_second() -> None:
    turn = np.zeros((4000, 3))
    turn[1000:3000] = 30.0 * np.sin(np.arange(2000) / 20)[:, None]
    results = stillness(step_means(sampled(turn)), None)
    assert [run.begin - START for run in results.runs] == pytest.approx([0, 30], abs=1.2)
    assert [run.end - START for run in results.runs] == pytest.approx([10, 40], abs=1.2)
    assert results.longest == max(results.runs, key=lambda run: run.seconds)


# ── simulated motions ────────────────────────────────────────────────────────────────────────────────────────────────


@each_row("name", sorted(set(MOTIONS) - {"drive"}))
def test_a_motion_turns_as_its_gyroscope_measures(name: str) -> None:
    t = np.arange(0, 20, 0.001)
    truth = MOTIONS[name](t)
    q = truth.q_enu_from_body_wxyz
    step = rotations.product(q[:-1] * [1, -1, -1, -1], q[1:])
    turned = 2 * step[:, 1:] * np.sign(step[:, :1]) / 0.001
    assert np.abs(turned - (truth.rate[1:] + truth.rate[:-1]) / 2).max() < 2e-3
    assert np.linalg.norm(truth.field, axis=1) == pytest.approx(1.0)
    felt = truth.force - rotations.to_body(q, truth.acceleration)
    assert np.linalg.norm(felt, axis=1) == pytest.approx(trajectory.GRAVITY)
    assert np.abs(np.gradient(truth.velocity, 0.001, axis=0) - truth.acceleration)[1:-1].max() < 1e-3


def test_errors_of_a_setup_are_those_that_the_calibrations_find() -> None:
    setup = SensorSetup(motion="tumble", hard_iron=0.4, soft_iron=0.1, gyro_bias=0.6)
    field = setup.field(setup.motion_at(np.arange(0, 80, 0.02)).field)
    report = magnetometer_iron(sampled(field, 50.0), "a.u.", 1.0)
    assert report.correction is not None
    assert report.progress == 1
    assert report.correction.bias == pytest.approx(0.4 * HARD_IRON, abs=1e-6)
    assert np.array(report.correction.matrix) == pytest.approx(np.linalg.inv(np.eye(3) + 0.1 * SOFT_IRON), abs=1e-6)
    rest = SensorSetup(motion="rest", gyro_bias=0.6)
    turn = np.degrees(rest.turn(rest.motion_at(np.arange(0, 40, 0.01)).rate))
    bias = gyroscope_bias(sampled(turn))
    assert bias.correction is not None
    assert bias.correction.bias == pytest.approx(0.6 * GYRO_BIAS, abs=1e-9)
    planar = SensorSetup(motion="turn")
    assert magnetometer_iron(sampled(planar.motion_at(np.arange(0, 80, 0.02)).field, 50.0), "").refusal is not None


def test_progress_of_a_turn_only_grows() -> None:
    field = SensorSetup(motion="tumble").motion_at(np.arange(0, 60, 0.02)).field
    shares = []
    for n in (200, 500, 1000, 2000, 3000):
        coverage = magnetometer_iron(sampled(field[:n], 50.0), "").coverage
        assert coverage is not None
        shares.append(coverage.share)
    assert all(b >= a - 0.05 for a, b in pairwise(shares))
    assert shares[0] < 0.5 < 0.9 <= shares[-1]
