"""Prepared questions: SQL that is read from the small tables only, so that it is quick over many recordings.

To add one, add a row; docs/fleet.md lists them, and a test asks each of an empty store and of recordings.
"""

from collections.abc import Mapping
from dataclasses import dataclass

AT_REST_DEGREES = 0.5
"""Standard deviation of the rate of turn, °/s, up to which a minute counts as rest: more is motion, or a defect."""
NEAR_ZERO_DEGREES = 3.0
"""Mean rate of turn, °/s, up to which a minute of rest is one: a steady turn is not rest. No usable gyroscope is
worse.
"""
STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True, slots=True)
class PreparedQuestion:
    """A question.

    Args:
        title: for people, and in the list.
        sql: of the answer.
    """

    title: str
    sql: str


_DEGREES = "(CASE unit WHEN 'rad/s' THEN 180 / pi() ELSE 1 END)"
_METRES = f"(CASE unit WHEN 'g' THEN {STANDARD_GRAVITY} ELSE 1 END)"

QUESTIONS: Mapping[str, PreparedQuestion] = {
    "gyro-bias": PreparedQuestion(
        "gyro bias over temperature by serial number, from minutes at rest",
        f"""WITH gyro AS (
    SELECT recording, device, minute, signal, axis, mean * {_DEGREES} AS bias, count
    FROM minutes WHERE quantity = 'rate of turn' AND axis IN ('x', 'y', 'z')
      AND sigma * {_DEGREES} <= {AT_REST_DEGREES} AND abs(mean) * {_DEGREES} <= {NEAR_ZERO_DEGREES}
), warmth AS (
    SELECT recording, device, minute, avg(mean) AS degrees
    FROM minutes WHERE quantity = 'temperature' GROUP BY ALL
)
SELECT product, serial_number, signal, round(degrees / 5) * 5 AS temperature_c,
       sum(bias * gyro.count) / sum(gyro.count) AS bias_deg_per_s, count(*) AS minutes
FROM gyro JOIN warmth USING (recording, device, minute) JOIN devices USING (recording, device)
GROUP BY ALL ORDER BY ALL""",
    ),
    "loss-by-adapter": PreparedQuestion(
        "loss by adapter",
        """SELECT adapter, link, count(*) AS recordings, sum(duration_s) / 3600 AS hours,
       sum(messages)::BIGINT AS messages, sum(lost)::BIGINT AS lost,
       1e6 * sum(lost) / nullif(sum(lost) + sum(messages), 0) AS lost_ppm,
       sum(gaps)::BIGINT AS gaps, sum(rejects)::BIGINT AS rejects
FROM devices GROUP BY adapter, link ORDER BY lost_ppm DESC NULLS LAST, adapter, link""",
    ),
    "shocks": PreparedQuestion(
        "drives with |a| > 3 g, the hardest first",
        f"""WITH hard AS (
    SELECT recording, device, max(max * {_METRES}) / {STANDARD_GRAVITY} AS peak_g, count(*) AS minutes,
           arg_max(minute, max * {_METRES}) AS hardest_minute
    FROM minutes WHERE quantity = 'acceleration' AND axis = 'norm' AND max * {_METRES} > 3 * {STANDARD_GRAVITY}
    GROUP BY ALL
)
SELECT recordings.robot, started, title, product, serial_number, peak_g, hard.minutes, hardest_minute, recording, object
FROM hard JOIN devices USING (recording, device) JOIN recordings USING (recording)
ORDER BY peak_g DESC, started""",
    ),
    "noise-by-batch": PreparedQuestion(
        "noise against the data sheet by batch: the first five characters of the serial number",
        f"""WITH noise AS (
    SELECT product, serial_number, quantity,
           median(noise * CASE quantity WHEN 'rate of turn' THEN {_DEGREES} * pi() / 180 ELSE {_METRES} END) AS density,
           any_value(CASE quantity WHEN 'rate of turn' THEN gyro_noise ELSE accelerometer_noise END) AS data_sheet
    FROM minutes JOIN devices USING (recording, device)
    WHERE quantity IN ('rate of turn', 'acceleration') AND axis IN ('x', 'y', 'z') AND noise IS NOT NULL
    GROUP BY product, serial_number, quantity
)
SELECT product, left(serial_number, 5) AS batch, quantity,
       CASE quantity WHEN 'rate of turn' THEN 'rad/s/√Hz' ELSE 'm/s²/√Hz' END AS unit,
       median(density) AS noise, max(density) AS worst, any_value(data_sheet) AS data_sheet,
       median(density) / nullif(any_value(data_sheet), 0) AS ratio, count(serial_number) AS devices
FROM noise
GROUP BY product, batch, quantity ORDER BY ratio DESC NULLS LAST, product, batch, quantity""",
    ),
}
