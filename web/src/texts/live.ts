/** Texts of Live and of what every page has: bar, devices, bands. */
import { count, numeral, plural } from "./plural";
import type { Value } from "../wire/texts";

export const TEXT = {
  // app state
  live: "Live",

  // device sidebar
  addDeviceByAddress: "Add a device by its address",
  closeDeviceList: "Close the device list",
  otherSerialPorts: "Other serial ports",
  listening: "Listening…",
  scan: "Scan",
  noOtherSerialPort: "No other serial ports.",
  sameLink: "same link",
  baudRate: (baud: number) => count(baud, "Bd", "Bd"),
  protocolUnknown: "protocol not detected yet",
  productUnknownUntilRead: "product unknown until settings are read",
  productUnknown: "product unknown",
  messages: "messages of its driver",
  gapCount: (gaps: number) => count(gaps, "gap"),
  inTheLastMinute: "in the last minute",
  timeAgo: (value: Value, unit: Value) => `${value} ${unit} ago`,
  nextAttempt: (seconds: Value) => `next attempt in ${seconds} s`,
  restarted: "Restarted",
  confirmRemoveLink: (devices: number) => `Remove all ${count(devices, "device")} on this link?`,
  confirmRemove: (name: Value) => `Remove ${name}?`,
  remove: "Remove",
  playAgain: "Play again",
  tryNow: "Try now",
  reading: "Decoding…",
  isLoading: (name: Value) => `Loading samples of ${name}`,
  samplesOnTheirWay: "The device is sending; its samples are on their way to this page.",
  notConnectedHere: "Not connected",
  dismiss: "Dismiss",
  linkNames: (name: Value) => `The link names ${name}, which is not connected here. Another device is shown.`,
  liveBehind: (value: Value, unit: Value) => `Live, ${value} ${unit} behind`,
  nameDevice: "Name…",
  nameOf: (name: Value) => `Name of ${name}`,
  nameHint: "Stored with its serial number on this server; nothing is written to the device.",
  notConfirmedSince: (time: Value) => `not confirmed since ${time}`,
  maybeAnother:
    "It had stopped sending. Whether this is still the same sensor is known once it reports its number, or its settings are read.",
  removeLink: "Remove link",
  samplesPerSecondLastMinute: "Samples per second, last minute",
  connectTo: (device: Value) => `Connect to ${device}`,
  connect: "Connect",
  inUseBy: (busy: Value) => `In use by ${busy}.`,
  notScanned: (description: Value) => `${description}. Not scanned yet.`,

  // drop
  dropToAdd: "Drop files to add them to the recordings",

  // first minute
  simulatedSensors: (devices: number) => `${numeral(devices)} simulated ${plural(devices, "sensor")}`,
  connectYours: "Connect yours",
  openAFile: "Open a file",
  whatIsThis: "What am I looking at?",
  tour: [
    {
      title: "Devices",
      words:
        "Each sensor with its rate, its link and the samples of the last minute. Choose one to see it; + adds one by its address.",
    },
    {
      title: "Time",
      words:
        "The page follows the newest sample. Pause, or drag the plots, to go back: the last ten minutes are in memory.",
    },
    {
      title: "Plots",
      words:
        "One plot for each quantity. A click pins cursor A, Shift-click cursor B, and a table has the figures between them.",
    },
    {
      title: "Values and health",
      words:
        "The newest value of everything, and how far it can be trusted: samples lost, where, and how late data arrive.",
    },
    {
      title: "Record",
      words:
        "Keeps every byte of all devices, to be replayed, measured, compared and exported. Help leads to the guide.",
    },
  ] as const,
  stopOf: (stop: Value, stops: Value) => `Stop ${stop} of ${stops}`,
  tourBack: "Back",
  tourNext: "Next",
  endTour: "End the tour",

  // empty states
  accessRefused: "Access refused by the server",
  connectingToImuscope: "Connecting to imuscope",
  connectingToServer: "Connecting to the server…",
  openPrintedAddress: "Open the address that imuscope printed at startup; it contains the token.",
  reload: "Reload",
  noDeviceYet: "No device yet",
  plugInSensor: "Plug in a sensor, enter the address of one, or drop a recording on this page.",
  noSerialPort: "No serial port found on this host.",
  scanningPorts: "Scanning all ports…",
  scanPorts: "Scan ports",
  addAnAddress: "Add an address",
  startASimulator: "Start a simulator",
  connectingTo: (source: Value) => `Connecting to ${source}`,
  attemptsFollow: "Connection attempts are listed below.",
  noPermissionFor: (source: Value) => `No permission for ${source}`,
  portPermissionDenied: "The operating system denies imuscope access to this port.",
  grantPortAccess: "Grant the user that runs imuscope access to the port, then try again.",
  cannotBeReached: (name: Value) => `${name} cannot be reached`,
  isSilent: (name: Value) => `${name} is connected but sends no data`,
  linkUpNoSample: "The link is up, but no sample has arrived.",
  silentHint:
    "Check that the device is in measurement mode and that its outputs are enabled. A device in configuration mode sends no data.",
  setBaudRate: "Set baud rate",
  addAnotherAddress: "Add another address",
  attempts: "Connection attempts",
  nextAttemptIn: (seconds: Value) => `Next attempt in ${seconds} s.`,
  tryingNow: "Trying now.",
  hasEnded: "has ended",
  isIdle: "is idle",
  lastSampleAgo: (value: Value, unit: Value) => ` Last sample ${value} ${unit} ago.`,
  noConnection: "No connection to imuscope",
  noDataFromServer: "No data from imuscope",
  serverStopped: "The server has stopped or the network is down. Showing earlier data; reconnecting.",
  silentFor: (value: Value, unit: Value) =>
    `For ${value} ${unit}: the network is down or the server does not respond. Showing earlier data.`,

  // key banner
  sequenceRestarted: (sender: Value) => `Sequence of ${sender} restarted`,
  oldSequenceNumbers: (sender: Value) =>
    `Device ${sender} sends old sequence numbers, which Secure mode rejects. If you restarted the device, re-arm it. If not, captured frames may be being replayed.`,
  rearm: (sender: Value) => `Re-arm ${sender}`,
  shownUnverified: "Shown unverified",
  keyNeeded: "Key required",
  unverifiedData: "The sender of these data could not be verified. ",
  enterKeyHere: "Enter the key here, or start with",
  keyOption: "--key",
  enterKey: "Enter key…",

  // record button
  shiftREndsRecording: "Shift R ends the recording",
  shiftRRecords: "Shift R starts a recording",
  markerSet: (kind: Value, time: Value) => `${kind} at ${time}`,
  shiftR: "Shift R",
  record: "Record",
  saveFromMemory: "Save or export from memory",
  saveFromMemoryHint: "Save or export what has just happened, from memory",
  partToSave: "Part to save",
  inView: "In view",
  lastMinute: "Last minute",
  allInMemory: "Everything",
  memoryReaches: (device: Value, time: Value, size: Value, unit: Value) =>
    `${device}: the last ${time} min are in memory, ${size} ${unit}.`,
  memoryEmpty:
    "No bytes are in memory. The server keeps those that devices have sent since it was started, unless bytes_mb is 0 in its configuration.",
  memoryGone: "The part in view is older than what is in memory.",
  memoryBeginsLater: (time: Value) => `Memory begins at ${time}, later than the part in view.`,
  saveAsRecording: "Save as recording",
  savingFromMemory: "Saving…",
  exportFromMemory: "Export…",
  memoryHint:
    "All bytes received from and sent to the devices are saved, with events and settings, as in any recording.",
  partOfLive: "From memory",
  readHeader: (devices: Value) =>
    `Read the configuration of ${devices} into the recording, for an .mtb export: pauses the measurement for about 90 ms`,
  recordAllDevices: "Record all devices (Shift R)",
  behindBy: (value: Value, unit: Value) => `${value} ${unit} behind`,
  diskFullIn: (time: Value) => `disk full in ${time}`,
  stopRecordingState: (time: Value, value: Value, unit: Value) => `Stop recording, ${time}, ${value} ${unit}`,
  stopRecordingTitle: (title: Value) => `Stop recording ${title} (Shift R)`,
  addMarker: "Add a marker",
  addMarkerHint: "Add a marker (M), or a note (Shift M)",
  recordingSaved: (title: Value) => `${title} saved`,
  noteAt: (time: Value) => `Note at ${time}`,
  discardNote: "Discard the note",

  // route
  configure: "Configure",

  // share
  copyLinkToView: "Copy a link to this view: device, window, plots, frame, cursors (C)",

  // shell
  pages: "Pages",

  // side panels
  valuesAndHealth: "Values and health",
  healthAndEvents: "Health and events",
  collapsePanel: "Collapse this panel",

  // top bar
  filtersAndMarkers: "Filters and markers",
  details: "Details",
  keys: "Keys (?)",
  showValuesAndHealth: "Show values and health",
  samplesPerSecond: (rate: Value) => `, ${rate} samples/s`,
  changesToConfirm: (changes: number) => `${count(changes, "change")} to confirm`,
  playState: "Playback state",
  followNewest: "Follow the newest sample (Space, End)",
  pauseView: "Pause the view; recording and devices continue (Space)",
  help: "Help",
  helpLabel: "Help: keys and guide",
  linkWord: "Link",
  theme: { dark: "dark", light: "light" },
  themeWord: { dark: "Dark", light: "Light" },
  useTheme: (theme: Value) => `Use the ${theme} theme`,
  windowLengthHint: "Window length ([ and ])",
  window: "Window",
  windowLength: "Window length",
  deviceTimeHint: "Time of measurement, by the device clock (T)",
  arrivalTimeHint: "Time of arrival at the host (T)",
  toMemoryStart: "Go to the oldest sample in memory (Home)",
  backTenth: "Back by a tenth of the window (←)",
  forwardTenth: "Forward by a tenth of the window (→)",
  toNow: "Go to now (End)",
  fitMemory: "Show everything in memory (F)",
  timeNavigation: "Time navigation",
  timeControls: "Time controls",
  timeAxisChoice: "Time axis: device or arrival time",
  arrival: "Arrival",

  // record button
  note: "Note",
};
