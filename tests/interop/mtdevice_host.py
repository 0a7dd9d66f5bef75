"""A host program based on ethzasl's mtdevice.py: identity, settings, two outputs, a second of data.

python mtdevice_host.py PORT BAUD [MEASUREMENTS], with the checkout's src folder on PYTHONPATH
"""

import itertools
import sys

from xsens_driver.mtdef import XDIGroup  # type: ignore[import-not-found]  # the checkout's
from xsens_driver.mtdevice import MTDevice  # type: ignore[import-not-found]

device = MTDevice(sys.argv[1], int(sys.argv[2]), timeout=0.05, autoconf=False, config_mode=True)
print(f"id {device.GetDeviceID():X}")
print(f"firmware {'.'.join(map(str, device.GetFirmwareRev()[:3]))}")
print(f"product {str(device.GetProductCode()).strip()}")
device.SetOutputConfiguration([(0x1020, 0xFFFF), (0x1060, 0xFFFF), (0x4020, 100)])
print(f"outputs {[(hex(kind), rate) for kind, rate in device.GetOutputConfiguration()]}")
device.GoToMeasurement()
expected = int(sys.argv[3]) if len(sys.argv) > 3 else 50
count, counters = 0, []
while count < expected:
    measurement = device.read_measurement()
    count += "Acceleration" in measurement
    counters.append(measurement["Timestamp"]["PacketCounter"])
print(f"accelerations {count}")
print(f"gaps {sum((b - a) % 65536 != 1 for a, b in itertools.pairwise(counters))}")
print(f"groups {XDIGroup.Acceleration:#x}")
