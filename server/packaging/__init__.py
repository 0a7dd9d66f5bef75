"""Files for the system that imuscope runs on: the udev rule and the systemd unit that `imuscope doctor` prints."""
