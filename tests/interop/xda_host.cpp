// A host program on Xsens' own library (xspublic): what an integrator's program does with an MTi, step by step.
//
//     xda_host PORT BAUD LOG.mtb
//
// Scans the port, opens the device, reads who it is and what it is set to, sets two outputs, measures, logs, and prints
// a line of what it found for each step; run.py compares them. Exit status 1 names the step that failed.
//
// In lib/xspublic of Xsens' ROS driver (a recent g++ lacks <cstring> in it):
//
//     CXXFLAGS="-O1 -include cstring" make
//     g++ -std=c++11 -I. -include cstring .../tests/interop/xda_host.cpp -o xda_host xscontroller/libxscontroller.a
//         xscommon/libxscommon.a xstypes/libxstypes.a -lpthread -ldl

#include <xscontroller/xscontrol_def.h>
#include <xscontroller/xsdevice_def.h>
#include <xscontroller/xsscanner.h>
#include <xstypes/xsdatapacket.h>
#include <xstypes/xsfilterprofilearray.h>
#include <xstypes/xsoutputconfigurationarray.h>
#include <xstypes/xsportinfo.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>

class Journaller;
Journaller* gJournal = nullptr;  // the library wants its host to define it

struct Counter : public XsCallback {
    std::atomic<int> packets{0}, accelerations{0};

    void onLiveDataAvailable(XsDevice*, const XsDataPacket* packet) override {
        ++packets;
        accelerations += packet->containsCalibratedAcceleration();
    }
};

static XsControl* control = nullptr;

static void need(bool done, const char* step) {
    if (done) return;
    XsResultValue last = control ? control->lastResult() : XRV_ERROR;
    std::printf("failed %s (result %d)\n", step, int(last));
    std::exit(1);
}

int main(int, char** words) {
    control = XsControl::construct();
    XsPortInfo port = XsScanner::scanPort(words[1], XsBaud::numericToRate(std::atoi(words[2])));
    need(!port.empty(), "scan");
    need(control->openPort(port.portName(), port.baudrate()), "open");
    XsDevice* device = control->device(port.deviceId());
    need(device != nullptr, "device");
    std::printf("id %s\n", device->deviceId().toString().c_str());
    std::printf("product %s\n", device->productCode().c_str());
    std::printf("firmware %s\n", device->firmwareVersion().toSimpleString().c_str());
    need(device->gotoConfig(), "GoToConfig");
    std::printf("profiles %d\n", int(device->availableOnboardFilterProfiles().size()));
    XsOutputConfigurationArray wanted;
    wanted.push_back(XsOutputConfiguration(XDI_PacketCounter, 0xFFFF));
    wanted.push_back(XsOutputConfiguration(XDI_SampleTimeFine, 0xFFFF));
    wanted.push_back(XsOutputConfiguration(XDI_Acceleration, 100));
    need(device->setOutputConfiguration(wanted), "SetOutputConfiguration");
    need(device->outputConfiguration() == wanted, "read-back of the output configuration");
    need(device->createLogFile(words[3]) == XRV_OK, "log file");
    Counter counter;
    device->addCallbackHandler(&counter);
    need(device->gotoMeasurement(), "GoToMeasurement");
    need(device->startRecording(), "recording");
    for (int waited = 0; waited < 600 && counter.accelerations < 200; ++waited) XsTime::msleep(100);
    need(device->stopRecording(), "end of the recording");
    need(device->gotoConfig(), "GoToConfig again");
    need(device->closeLogFile(), "closing the log file");
    std::printf("accelerations %s\n", counter.accelerations >= 200 ? "200 or more" : "missing");
    device->removeCallbackHandler(&counter);
    control->closePort(port.portName());
    control->destruct();
    return 0;
}
