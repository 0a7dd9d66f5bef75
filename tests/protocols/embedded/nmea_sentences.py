"""NMEA sentences with their checksums, and what they mean."""

from typing import Any

from tests.protocols.embedded.vectornav_sentences import VECTORNAV

EXAMPLES: dict[str, tuple[str, dict[str, Any]]] = {
    **VECTORNAV,
    "HCHDM": ("HCHDM,238.50,M", {"headingM": 238.5, "headingMag": "M"}),
    "HCHDG": (
        "HCHDG,98.3,1.5,E,12.6,W",
        {"headingM": 98.3, "deviation": 1.5, "deviationEW": "E", "variation": 12.6, "variationEW": "W"},
    ),
    "PHTRO": ("PHTRO,10.37,P,177.62,T", {"pitch": 10.37, "pitchSide": "P", "roll": 177.62, "rollSide": "T"}),
    "PRDID": ("PRDID,-10.37,2.34,230.34", {"pitch": -10.37, "roll": 2.34, "headingT": 230.34}),
    "PSONCMS": (
        "PSONCMS,0.0905,0.4217,0.9020,-0.0196,-09.1585,-00.2743,-03.3479,-00.0082,00.0025,-00.0046,00.0148,-00.3885,"
        "-00.6203,30.5",
        {
            **{"q0": 0.0905, "q1": 0.4217, "q2": 0.902, "q3": -0.0196},
            **{"accX": -9.1585, "accY": -0.2743, "accZ": -3.3479, "gyrX": -0.0082, "gyrY": 0.0025, "gyrZ": -0.0046},
            **{"magX": 0.0148, "magY": -0.3885, "magZ": -0.6203, "temp": 30.5},
        },
    ),
    "HCMTW": ("HCMTW,23.4,C", {"temp": 23.4, "tempu": "C"}),
    "HEHDT": ("HEHDT,274.07,T", {"headingT": 274.07, "headingTu": "T"}),
    "HEROT": ("HEROT,-012.3,A", {"rot": -12.3, "valid": "A"}),
    "GPGGA": (
        "GPGGA,172814.00,3723.46587704,N,12202.26957864,W,2,6,1.2,18.893,M,-25.669,M,,",
        {
            **{"time": "17:28:14", "lat": 37 + 23.46587704 / 60, "NS": "N", "lon": -(122 + 2.26957864 / 60), "EW": "W"},
            **{"quality": 2, "numSV": 6, "HDOP": 1.2, "alt": 18.893, "altUnit": "M", "sep": -25.669, "sepUnit": "M"},
            **{"diffAge": None, "diffStation": None},
        },
    ),
    "PTCF": (
        "PTCF,110.8,T, 001.9,-00.6,-000.1, 000.0",
        {"heading": 110.8, "headingRef": "T", "roll": 1.9, "pitch": -0.6, "rollRate": -0.1, "pitchRate": 0.0},
    ),
    "PIMU": (
        "PIMU,3218.543,0.0017,-0.0059,-0.0077,-1.417,-1.106,-9.524",
        {
            **{"time": 3218.543, "pqrX": 0.0017, "pqrY": -0.0059, "pqrZ": -0.0077},
            **{"accX": -1.417, "accY": -1.106, "accZ": -9.524},
        },
    ),
    "PRIMU": ("PRIMU,1.5,0.1,0.2,0.3,1.0,2.0,9.8", {"time": 1.5, "pqrX": 0.1, "accZ": 9.8}),
    "PPIMU": (
        "PPIMU,1.5,0.0001,0.0002,0.0003,0.01,0.02,0.098,0.010",
        {"dthetaX": 0.0001, "dvelZ": 0.098, "dt": 0.01},
    ),
    "PINS1": (
        "PINS1,244272.398,2021,427888998,805306448,0.1244,-0.0665,-2.6127,0.277,-0.147,-0.089,40.05574940,"
        "-111.65861580,1438.451,0.001,0.002,0.003",
        {
            **{"timeOfWeek": 244272.398, "week": 2021, "insStatus": 427888998, "hdwStatus": 805306448},
            **{"thetaRoll": 0.1244, "thetaPitch": -0.0665, "thetaYaw": -2.6127, "uvwX": 0.277, "uvwZ": -0.089},
            **{"lat": 40.0557494, "lon": -111.6586158, "hae": 1438.451, "nedN": 0.001, "nedD": 0.003},
        },
    ),
    "PINS2": (
        "PINS2,244272.398,2021,427888998,805306448,0.9996,0.0249,-0.0116,0.0081,0.277,-0.147,-0.089,40.05574940,"
        "-111.65861580,1438.451",
        {"week": 2021, "q0": 0.9996, "q3": 0.0081, "uvwY": -0.147, "hae": 1438.451},
    ),
    "PGPSP": (
        "PGPSP,337272200,2031,1075643160,40.33057800,-111.72581630,1406.39,1425.18,0.95,0.37,0.55,-0.02,0.02,-0.03,"
        "0.17,39.5,337182.4521,18",
        {
            **{"timeOfWeekMs": 337272200, "week": 2031, "status": 1075643160, "lat": 40.330578, "hae": 1406.39},
            **{"hMSL": 1425.18, "pDop": 0.95, "hAcc": 0.37, "vAcc": 0.55, "velX": -0.02, "velZ": -0.03, "sAcc": 0.17},
            **{"cnoMean": 39.5, "towOffset": 337182.4521, "leapS": 18},
        },
    ),
    "PSTRB": ("PSTRB,2031,337272200,9,3", {"week": 2031, "timeOfWeekMs": 337272200, "pin": 9, "count": 3}),
    "INFO": (
        "INFO,62123,5.0.4.0,2.7.1.0,7,2.0.0.0,654364672,Inertial Sense Inc,2026-01-01,12:30:00.00,simulator,3,2,r",
        {
            **{"serialNumber": 62123, "hardwareVer": "5.0.4.0", "firmwareVer": "2.7.1.0", "buildNumber": 7},
            **{"manufacturer": "Inertial Sense Inc", "buildDate": "2026-01-01", "hardwareType": 3, "buildType": "r"},
        },
    ),
    "ASCE": ("ASCE,0,4,1,7,5", {"options": 0, "id_1": 4, "period_1": 1, "id_2": 7, "period_2": 5}),
    "ASCB": ("ASCB,512,13,2", {"options": 512, "id_1": 13, "period_1": 2}),
    "INTEL": (
        "INTEL,KIM,1.2.3.4,337272,2031,18,0.5,-0.5,0,0.1,0.2,0.3,1.1,1.2,1.3",
        {"id": "KIM", "timeOfWeek": 337272, "leapS": 18, "ppsPhase2": -0.5, "velX": 0.1, "velN": 1.1, "velD": 1.3},
    ),
    "POWGPS": (
        "POWGPS,1,2360,337272200000,1,18,0",
        {"timeValid": 1, "week": 2360, "timeOfWeekUs": 337272200000, "leapS": 18, "holdover": 0},
    ),
    "POWTLV": (
        "POWTLV,1,2360,337272200000,1,18,0,4003.34496,N,11139.51695,W,1438.451,1457.2,0.5,0.1,90.0",
        {"latDegMin": 4003.34496, "NS": "N", "lonDegMin": 11139.51695, "EW": "W", "hae": 1438.451, "course": 90.0},
    ),
    "XSVEL": ("XSVEL, 001.2345,-002.0000, 000.125", {"velX": 1.2345, "velY": -2.0, "velZ": 0.125}),
    "GPZDA": (
        "GPZDA,201530.00,04,07,2020,00,00",
        {"time": "20:15:30", "day": 4, "month": 7, "year": 2020, "ltzh": "00", "ltzn": "00"},
    ),
    "GPRMC": (
        "GPRMC,123519,A,4807.03,N,01131.00,W,022.4,084.4,230320,003.1,W,",
        {
            **{"time": "12:35:19", "status": "A", "lat": 48 + 7.03 / 60, "NS": "N", "lon": -(11 + 31 / 60), "EW": "W"},
            **{"spd": 22.4, "cog": 84.4, "date": "2020-03-23", "mv": 3.1, "mvEW": "W"},
        },
    ),
}


TSS2 = b":12345  0000H-0150  0250F"


EM1000 = bytes.fromhex("00 90 6A FF FA 00 00 00 39 30")  # −150, 250, 0, 12345: least significant byte first
