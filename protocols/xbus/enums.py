"""Enumerations and flag words of Xbus, as data.

Names are the document's; values and bits that it leaves open but the devices' own software uses have their meaning
here, and a doc that says the document does not list them.

Source: MT0101P 2020.A, the table named at each entry, with its errata.
"""

from imuscope.protocols.schema.fields import Bits

# -- enumerations ------------------------------------------------------------------------------------------------------

ERROR_CODES = {  # Table 5; from 35 on the further values of the device's result list
    1: "no bus communication possible",
    2: "bus not ready",
    3: "period outside the valid range",
    4: "message invalid",
    30: "timer overflow: output rate too high, or too much data sent to the device while measuring",
    32: "baud rate outside the valid range",
    33: "parameter invalid or outside its range",
    35: "measurement failed: transmit buffer full",
    36: "measurement failed: transmit buffer overflow",
    40: "device error: try a firmware update",
    41: "data overflow: the baud rate is too low for the outputs",
    42: "buffer overflow",
    43: "external trigger error",
    44: "sample stream error",
    45: "power dip",
    46: "power overcurrent",
    47: "overheating",
    48: "battery low",
    49: "invalid filter profile",
    50: "invalid stored settings",
    51: "access denied",
    53: "output configuration error",
}

DEVICE_ERRORS = {  # the four bytes that follow error 40
    0: "unknown",
    1: "IMCU timeout",
    2: "IMCU settings invalid",
    3: "IMCU settings failure",
    4: "IMCU eMTS write failure",
    5: "IMCU eMTS read failure",
    6: "DSP crashed",
    7: "DSP boot timeout",
    8: "DSP settings invalid",
}

WARNING_CODES = {  # Table 6; from 404 on the further values of the device's result list
    401: "the GNSS module rejected a configuration item",
    402: "communication with the GNSS module timed out",
    403: "communication with the GNSS module failed",
    404: "the device is not calibrated",
    405: "the GNSS connection is lost",
    406: "the GNSS input rate is too low",
    407: "the GNSS data set is incomplete",
}

BAUD_CODES = {  # Table 7, with 0x0E and 0x03 as the devices mean them
    0x0D: "4 000 000 Bd",
    0x0E: "3 500 000 Bd",
    0x0C: "2 000 000 Bd",
    0x80: "921 600 Bd",
    0x0A: "921 600 Bd",
    0x00: "460 800 Bd",
    0x01: "230 400 Bd",
    0x02: "115 200 Bd",
    0x03: "76 800 Bd",
    0x04: "57 600 Bd",
    0x05: "38 400 Bd",
    0x06: "28 800 Bd",
    0x07: "19 200 Bd",
    0x08: "14 400 Bd",
    0x09: "9 600 Bd",
    0x0B: "4 800 Bd",
    0xFF: "invalid",
}

CAN_BAUD_CODES = {  # as in xspublic, XsCanBaudCode; the document has no table of them
    0x0C: "1 Mbit/s",
    0x0B: "800 kbit/s",
    0x0A: "500 kbit/s",
    0x00: "250 kbit/s",
    0x01: "125 kbit/s",
    0x02: "100 kbit/s",
    0x03: "83.3 kbit/s",
    0x04: "62.5 kbit/s",
    0x05: "50 kbit/s",
    0x06: "33.3 kbit/s",
    0x07: "20 kbit/s",
    0x08: "10 kbit/s",
    0x09: "5 kbit/s",
}

SYNC_FUNCTIONS = {  # Table 11; the others from the device's own list
    0: "StartRecordingIn",
    1: "StopRecordingIn",
    2: "ResetTimer",
    3: "TriggerIndication",
    4: "IntervalTransitionMeasurement",
    5: "IntervalTransitionRecording",
    6: "GotoOperational",
    7: "SampleAndSend",
    8: "SendLatest",
    9: "ClockBiasEstimation",
    10: "PulseWithModulation",
    11: "StartSampling",
    12: "StartRecordingOut",
    13: "StopRecordingOut",
    14: "Gnss1Pps",
    15: "BusSync",
}
TRIGGER, INTERVAL, SEND_LATEST, CLOCK_BIAS, START_SAMPLING, PULSE = 3, 4, 8, 9, 11, 14
SYNC_OUT = (INTERVAL, PULSE)

SYNC_LINES = {  # Table 12; what a number means depends on the series
    0: "ClockIn",
    1: "GpsClockIn",
    2: "In1",
    4: "SyncOut",
    5: "ExtTimepulseIn",
    6: "Software",
    7: "SyncOut (600-series)",
    8: "Gnss1Pps",
    9: "In2",
    10: "In3",
}

POLARITIES = {  # Tables 9 and 10
    0: "disabled",
    1: "rising edge, positive pulse",
    2: "falling edge, negative pulse",
    3: "both edges, toggle",
}

ALIGNMENTS = {0: "RotSensor", 1: "RotLocal"}  # Table 20

RESET_CODES = {  # Table 33
    0: "store the current settings",
    1: "heading reset",
    2: "reserved",
    3: "object or inclination reset",
    4: "alignment reset",
    5: "default heading",
    6: "default inclination",
    7: "default alignment",
}

FILTER_PROFILES = {  # Table 30
    1: "General",
    2: "GeneralNoBaro",
    3: "GeneralMag",
    4: "Automotive",
    5: "HighPerformanceEDR",
    11: "General",
    12: "GeneralNoBaro",
    13: "GeneralMag",
    39: "General",
    40: "High_mag_dep",
    41: "Dynamic",
    42: "Low_mag_dep",
    43: "VRU_general",
    50: "General",
    51: "High_mag_dep",
    52: "Dynamic",
    53: "North_reference",
    54: "VRU_general",
}

GNSS_PLATFORMS = {  # Table 31 lists 0 and 8
    0: "Portable",
    2: "Stationary",
    3: "Pedestrian",
    4: "Automotive",
    5: "At sea",
    6: "Airborne <1 g",
    7: "Airborne <2 g",
    8: "Airborne <4 g",
    9: "Wrist",
}

ICC_COMMANDS = {  # Table 36; 4 is not in the document
    0: "start representative motion",
    1: "stop representative motion",
    2: "store ICC parameters",
    3: "get representative motion state",
    4: "get ICC status",
}

ICC_DIMENSIONS = {2: "2D", 3: "3D"}  # Table 39

ERROR_MODES = {  # earlier revisions of the document
    0: "ignore",
    1: "increase the packet counter",
    2: "increase the packet counter and send Error",
    3: "send Error and go to the Config State",
}

GNSS_FIXES = {  # Table 25
    0: "no fix",
    1: "dead reckoning",
    2: "2D fix",
    3: "3D fix",
    4: "GNSS and dead reckoning",
    5: "time only",
}

GNSS_SYSTEMS = {  # Table 26
    0: "GPS",
    1: "SBAS",
    2: "Galileo",
    3: "BeiDou",
    4: "IMES",
    5: "QZSS",
    6: "GLONASS",
}

CAN_FORMATS = {0: "11 bit", 1: "29 bit"}

# -- flag words --------------------------------------------------------------------------------------------------------


def _flags(names: str, *, doc: str = "", normal_set: bool = False) -> tuple[Bits, ...]:
    return tuple(Bits(name, i, doc=doc.format(name), normal_set=normal_set) for i, name in enumerate(names.split()))


STATUS_BITS = (  # Table 27
    Bits("Selftest", 0, normal_set=True, doc="The self-test passed at start; always 0 on the 600-series."),
    Bits(
        "FilterValid",
        1,
        severity="error",
        normal_set=True,
        doc="The orientation filter's input is complete and reliable; clears when a sensor's range is exceeded.",
    ),
    Bits("GnssFix", 2, normal_set=True, doc="The GNSS receiver has a valid fix."),
    Bits(
        "NoRotationUpdateStatus",
        3,
        width=2,
        choices={
            0: "complete",
            1: "samples rejected",
            2: "rotation detected, no bias estimated",
            3: "running, device assumed still",
        },
        doc="State of the no-rotation update started by SetNoRotation; value 1 is not in the document.",
    ),
    Bits("RepresentativeMotion", 5, doc="In-run compass calibration is collecting representative motion."),
    Bits("ClockSync", 6, doc="Clock bias estimation against an external clock is active."),
    Bits("FilterInputStart", 7, doc="First sample of the filter's input; reserved in the document."),
    Bits("ClipAccX", 8, severity="warning", doc="Acceleration along x is out of range."),
    Bits("ClipAccY", 9, severity="warning", doc="Acceleration along y is out of range."),
    Bits("ClipAccZ", 10, severity="warning", doc="Acceleration along z is out of range."),
    Bits("ClipGyrX", 11, severity="warning", doc="Rate of turn about x is out of range."),
    Bits("ClipGyrY", 12, severity="warning", doc="Rate of turn about y is out of range."),
    Bits("ClipGyrZ", 13, severity="warning", doc="Rate of turn about z is out of range."),
    Bits("ClipMagX", 14, severity="warning", doc="Magnetic field along x is out of range."),
    Bits("ClipMagY", 15, severity="warning", doc="Magnetic field along y is out of range."),
    Bits("ClipMagZ", 16, severity="warning", doc="Magnetic field along z is out of range."),
    Bits("Reserved17", 17, doc="Reserved."),
    Bits("Retransmitted", 18, doc="This sample was retransmitted; reserved in the document."),
    Bits("ClippingIndication", 19, severity="error", doc="At least one sensor is out of range."),
    Bits("Interpolated", 20, severity="warning", doc="This sample was interpolated; reserved in the document."),
    Bits("SyncInMarker", 21, doc="A trigger was detected on a SyncIn line."),
    Bits("SyncOutMarker", 22, doc="A pulse was output on the SyncOut line."),
    Bits(
        "FilterMode",
        23,
        width=3,
        choices={0: "without GNSS", 1: "coasting", 3: "with GNSS"},
        doc="Filter mode of a GNSS/INS device; coasting: GNSS lost less than 60 s ago.",
    ),
    Bits("HaveGnssTimePulse", 26, doc="The GNSS receiver's pulse per second is present."),
    Bits(
        "RtkStatus",
        27,
        width=2,
        choices={0: "no RTK", 1: "RTK floating", 2: "RTK fixed"},
        doc="RTK status: use of carrier-phase corrections and their ambiguity resolution.",
    ),
)

STATUS_BYTE_BITS = tuple(bits for bits in STATUS_BITS if bits.low < 8)

SELFTEST_BITS = (  # section 5.3.2; a set bit is a test passed
    *_flags("accX accY accZ gyrX gyrY gyrZ magX magY magZ", doc="The self-test of {} passed.", normal_set=True),
    Bits("Baro", 9, doc="The barometer was found and works (MTi-7)."),
    Bits("GNSS", 10, doc="The GNSS module was found (MTi-7)."),
    Bits("Battery", 11, doc="Reserved in the document."),
    Bits("Flash", 12, doc="Reserved in the document."),
    Bits("Button", 13, doc="Reserved in the document."),
    Bits("Sync", 14, doc="Reserved in the document."),
)

OPTION_FLAGS = (  # Table 8
    Bits("DisableAutoStore", 0, doc="Settings are not written to flash and are lost at the next reset."),
    Bits("DisableAutoMeasurement", 1, doc="The device stays in the Config State after start-up."),
    Bits("EnableBeidou", 2, doc="BeiDou is received instead of GLONASS."),
    Bits("DisableGps", 3, doc="Reserved in the document."),
    Bits("EnableAhs", 4, doc="Active heading stabilisation: heading is tracked, not referenced to the field."),
    Bits("EnableOrientationSmoother", 5, doc="Orientation jumps caused by GNSS updates are smoothed."),
    Bits("EnableConfigurableBusId", 6, doc="The configured bus identifier is used instead of 0xFF."),
    Bits("EnableInRunCompassCalibration", 7, doc="Magnetic disturbances that move with the object are calibrated out."),
    Bits("EnableConfigMessageAtStartup", 9, doc="eMTS and Configuration messages are sent at start-up."),
    Bits("EnableColdFilterResets", 10, doc="The filter performs a cold start at every GoToMeasurement."),
    Bits("EnablePositionVelocitySmoother", 11, doc="Position and velocity are smoothed."),
    Bits("EnableContinuousZRU", 12, doc="Gyroscope bias and noise are continuously updated (zero-rotation update)."),
    Bits("EnableRawGnssInputForwarding", 13, doc="Not in the document."),
)

EXT_OUTPUT_MODE_BITS = (  # Table 21
    Bits("AlternativeUart", 4, doc="Communication is on the alternative UART instead of the main serial line."),
    Bits("UsbLowLatency", 5, doc="USB uses low-latency mode."),
)

STRING_TYPES = (  # table of SetStringOutputType, section 5.3.5
    Bits("HCHDM", 0, doc="NMEA: magnetic heading."),
    Bits("HCHDG", 1, doc="NMEA: heading with deviation and variation."),
    Bits("TSS2", 2, doc="TSS2 line: heading, heave, roll, pitch."),
    Bits("PHTRO", 3, doc="NMEA: pitch and roll."),
    Bits("PRDID", 4, doc="NMEA: pitch, roll and true heading."),
    Bits("EM1000", 5, doc="EM1000 binary record: roll, pitch, heave, heading."),
    Bits("PSONCMS", 6, doc="NMEA: quaternion, acceleration, rate of turn, magnetic field, temperature."),
    Bits("HCMTW", 7, doc="NMEA: temperature."),
    Bits("HEHDT", 8, doc="NMEA: true heading."),
    Bits("HEROT", 9, doc="NMEA: rate of turn about z."),
    Bits("GPGGA", 10, doc="NMEA: position fix."),
    Bits("PTCF", 11, doc="NMEA: heading, roll, pitch and their rates."),
    Bits("XSVEL", 12, doc="NMEA: velocity."),
    Bits("GPZDA", 13, doc="NMEA: date and time."),
    Bits("GPRMC", 14, doc="NMEA: recommended minimum of a GNSS fix."),
    Bits("Reserved15", 15, doc="Reserved for further string types."),
)

PORT_WORD = (  # Figure 2
    Bits("Baud", 0, width=8, choices=BAUD_CODES, doc="Baud rate of the port, as in Table 7."),
    Bits("FlowControl", 8, doc="Hardware flow control is on."),
    Bits("SecondStopBit", 9, doc="Reserved in the document."),
    Bits("Parity", 10, doc="Reserved in the document."),
    Bits("OddParity", 11, doc="Reserved in the document."),
    Bits("Protocol", 16, width=4, choices={0: "none", 1: "Xbus", 5: "NMEA"}, doc="Protocol of the port."),
)

CAN_WORD = (
    Bits("Baud", 0, width=8, choices=CAN_BAUD_CODES, doc="Baud rate of the CAN bus."),
    Bits("Enable", 8, doc="The CAN transceiver is on."),
)

UTC_FLAGS = (  # Table 35
    Bits("ValidTimeOfWeek", 0, normal_set=True, doc="The time of week is valid."),
    Bits("ValidWeekNumber", 1, normal_set=True, doc="The GNSS week number is valid."),
    Bits(
        "ValidUtc",
        2,
        normal_set=True,
        doc="UTC is valid and the leap seconds are known; takes 12.5 minutes after a cold start.",
    ),
)

GNSS_VALID = (  # Table 25
    Bits("ValidDate", 0, normal_set=True, doc="The UTC date is valid."),
    Bits("ValidTime", 1, normal_set=True, doc="The UTC time of day is valid."),
    Bits("FullyResolved", 2, normal_set=True, doc="UTC is known to the second."),
    Bits("ValidMag", 3, doc="The magnetic declination is valid; not in the document."),
)

GNSS_FLAGS = (  # Table 25
    Bits("ValidFix", 0, normal_set=True, doc="The fix is within the limits of DOP and accuracy."),
    Bits("DifferentialCorrections", 1, doc="Differential corrections are applied."),
    Bits("HeadingOfVehicleValid", 5, doc="headVeh is valid."),
    Bits(
        "CarrierSolution",
        6,
        width=2,
        choices={0: "none", 1: "floating", 2: "fixed"},
        doc="Carrier-phase solution; not in the document.",
    ),
)

SATELLITE_FLAGS = (  # Table 26
    Bits(
        "Quality",
        0,
        width=3,
        choices={
            0: "no signal",
            1: "searching",
            2: "acquired",
            3: "detected, not usable",
            4: "code locked",
            5: "code and carrier locked",
            6: "code and carrier locked",
            7: "code and carrier locked",
        },
        doc="Quality of the signal.",
    ),
    Bits("UsedForNavigation", 3, doc="The satellite is used in the solution."),
    Bits("Health", 4, width=2, choices={0: "unknown", 1: "healthy", 2: "unhealthy"}, doc="Health of the satellite."),
    Bits("DifferentialCorrection", 6, doc="Correction data are available for the satellite."),
)
