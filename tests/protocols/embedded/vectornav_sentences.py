"""Examples of VectorNav's manuals: the body of each message, and some of its values.

The manuals print most of them as replies to a read register ("$VNRRG,27,…"), with the same fields.
"""

from typing import Any

_ANGLES = "+006.380,+000.023,-001.953"
_SENSORS = "+1.0640,-0.2531,+3.0614,+00.005,+00.344,-09.758,-0.001222,-0.000450,-0.001218"
_QUATERNION = "-0.017057,-0.000767,+0.056534,+0.998255"
_PLACE = "+32.95680804,-096.71414860,+00179.592,+000.181,-000.073,-000.050"
_ECEF = "-626343.88590823,-5320499.92650050,+3450022.606,+000.001,-000.010,+000.094"
_INS = "333811.902862,1694,0004,+009.500,-004.754,-000.225"
_FIX = "333733.000159,1694,3,05"

VECTORNAV: dict[str, tuple[str, dict[str, Any]]] = {
    "VNYPR": ("VNYPR,+006.271,+000.031,-002.000", {"Yaw": 6.271, "Pitch": 0.031, "Roll": -2.0}),
    "VNQTN": (f"VNQTN,{_QUATERNION}", {"Quat0": -0.017057, "Quat3": 0.998255}),
    "VNQMR": (f"VNQMR,{_QUATERNION},{_SENSORS}", {"Quat2": 0.056534, "MagX": 1.064, "GyroZ": -0.001218}),
    "VNMAG": ("VNMAG,+1.0640,-0.2531,+3.0614", {"MagX": 1.064, "MagY": -0.2531, "MagZ": 3.0614}),
    "VNACC": ("VNACC,+00.005,+00.344,-09.758", {"AccelX": 0.005, "AccelY": 0.344, "AccelZ": -9.758}),
    "VNGYR": ("VNGYR,-0.001222,-0.000450,-0.001218", {"GyroX": -0.001222, "GyroZ": -0.001218}),
    "VNMAR": (f"VNMAR,{_SENSORS}", {"MagZ": 3.0614, "AccelZ": -9.758, "GyroX": -0.001222}),
    "VNYMR": (
        f"VNYMR,{_ANGLES},{_SENSORS}",
        {"Yaw": 6.38, "Pitch": 0.023, "Roll": -1.953, "MagX": 1.064, "AccelY": 0.344, "GyroZ": -0.001218},
    ),
    "VNYBA": (
        f"VNYBA,{_ANGLES},+00.011,-00.024,+00.033,-0.001222,-0.000450,-0.001218",
        {"Roll": -1.953, "BodyAccelX": 0.011, "BodyAccelZ": 0.033, "GyroY": -0.00045},
    ),
    "VNYIA": (
        f"VNYIA,{_ANGLES},+00.011,-00.024,+00.033,-0.001222,-0.000450,-0.001218",
        {"Yaw": 6.38, "InertialAccelY": -0.024, "GyroZ": -0.001218},
    ),
    "VNIMU": (
        f"VNIMU,{_SENSORS},+25.1,+101.325",
        {"MagX": 1.064, "GyroZ": -0.001218, "Temp": 25.1, "Pressure": 101.325},
    ),
    "VNGPS": (
        f"VNGPS,{_FIX},+32.95622080,-096.71415970,+00169.457,-000.850,-000.580,-002.860,+005.573,+003.644,+009.760,"
        "+003.320,2.00E-08",
        {
            **{"Time": 333733.000159, "Week": 1694, "GpsFix": 3, "NumSats": 5, "Latitude": 32.9562208},
            **{"Altitude": 169.457, "VelN": -0.85, "VelD": -2.86, "VertAcc": 9.76, "SpeedAcc": 3.32, "TimeAcc": 2e-8},
        },
    ),
    "VNGPE": (
        f"VNGPE,{_FIX},{_ECEF},+005.573,+003.644,+009.760,+003.320,2.00E-08",
        {"Week": 1694, "PositionX": -626343.88590823, "VelocityZ": 0.094, "PosAccX": 5.573, "TimeAcc": 2e-8},
    ),
    "VNINS": (
        f"VNINS,{_INS},{_PLACE},07.8,01.6,0.23",
        {
            **{"Time": 333811.902862, "Week": 1694, "Status": "0004", "Yaw": 9.5, "Roll": -0.225},
            **{"Longitude": -96.7141486, "VelE": -0.073, "AttUncertainty": 7.8, "VelUncertainty": 0.23},
        },
    ),
    "VNINE": (
        f"VNINE,{_INS},{_ECEF},07.8,01.6,0.23",
        {"Status": "0004", "PositionZ": 3450022.606, "PosUncertainty": 1.6},
    ),
    "VNISL": (
        f"VNISL,+170.420,+001.398,+001.806,{_PLACE},+00.209,-00.322,-10.040,+00.000295,-00.000911,-00.000905",
        {"Yaw": 170.42, "Latitude": 32.95680804, "VelD": -0.05, "AccelZ": -10.04, "GyroX": 0.000295},
    ),
    "VNISE": (
        f"VNISE,+170.558,+001.267,+001.762,{_ECEF},+00.255,-00.308,-10.060,+00.001502,-00.000403,+00.000394",
        {"Pitch": 1.267, "PositionY": -5320499.9265005, "VelocityY": -0.01, "AccelX": 0.255, "GyroZ": 0.000394},
    ),
    "VNDTV": (
        "VNDTV,+0.665016,-000.119,-000.409,-000.025,+000.011,-000.084,-006.702",
        {"DeltaTime": 0.665016, "DeltaThetaX": -0.119, "DeltaThetaZ": -0.025, "DeltaVelZ": -6.702},
    ),
}
