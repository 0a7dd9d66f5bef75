/** Texts of the library and of a recording. */
import { count } from "./plural";
import type { Value } from "../wire/texts";

export const TEXT = {
  // details
  pin: "Pin: exempt from quota deletion",
  pinHint: "Pin: a pinned recording is exempt from quota deletion",
  closeDetails: "Close the details",
  damaged: "Damaged.",
  recordingInProgress: "Recording in progress. It can be opened when the recording ends.",
  downloadHint: "A single file that another imuscope can open",
  export: "Export…",
  playLoopHint: "Play in a loop as a device that all users see, at the pace at which the bytes arrived",
  playAsDevice: "Play as a device",
  canBeRestoredFor7Days: "Can be restored for 7 days",
  deletedKeptFor: (days: number) => `Deleted. It can be restored for ${count(days, "more day", "more days")}.`,
  restore: "Restore",
  recorded: "Recorded",
  unknown: "unknown",
  timeUtc: (time: Value) => `${time} UTC`,
  length: "Length",
  size: "Size",
  messages: "Messages",
  messagesUnit: "messages",
  samples: "samples",
  frames: "frames",
  noneKnown: "none known",
  lossesNotCounted: "losses not counted",
  lostCount: (lost: Value) => `${lost} lost`,
  fileNameHint: "File name in the recordings folder. Links to the recording use this name.",
  file: "File",
  notes: "Notes",
  tags: "Tags",
  addTag: "Add a tag, Enter",
  removeTag: (tag: Value) => `Remove tag ${tag}`,
  removeTagHint: "Remove tag",

  // export dialog
  exportRecording: (title: Value) => `Export ${title}`,
  part: "Part of the recording",
  whole: "All",
  rangeThen: (t0: Value, t1: Value) => `${t0} to ${t1}, `,
  fromStartToEnd: "From start to end, ",
  thenChannels: (n: number) => `, ${count(n, "channel")}`,
  byDeviceTime: ", by device time",
  byArrivalTime: ", by arrival time",
  format: "Format",
  units: "Units",
  unitsOf: { shown: "as on the page", SI: "SI", device: "as the device sent them" },
  about: (value: Value, unit: Value) => `about ${value} ${unit}`,
  roughly: (value: Value, unit: Value) => `roughly ${value} ${unit}`,
  exportState: { waiting: "waiting", failed: "failed", cancelled: "cancelled" },
  exportAs: (format: Value, size: Value) => `Export ${format}, ${size}`,
  channels: "Channels",
  chosenOfAll: (chosen: Value, all: Value) => `${chosen} of ${all}`,
  none: "None",
  exports: "Exports",
  removeFromList: "Dismiss",

  // library
  recordingsImuscope: "Recordings · imuscope",
  skipToTheList: "Skip to the list",
  thisRecording: "This recording",
  selectRecording: "Select a recording to see its details.",
  filters: "Filters",
  library: "Library",
  closeTheFilters: "Close the filters",
  recordingFilter: "Show",
  tag: "Tag",
  search: "Search",
  nameNoteTagDeviceDate: "Name, note, tag, device, date",
  recordingCount: (list: number) => count(list, "recording"),
  newestFirst: "· newest first",
  filesToAdd: "Files to add",
  addFiles: "Add files",
  addFilesHint: "Add recordings, logs or captures, or drop them here",
  filesBeingAdded: "Files being added",
  dismissFile: (name: Value) => `Dismiss ${name}`,
  doNotAdd: (name: Value) => `Do not add ${name}`,
  recordingDeleted: (title: Value) => `${title} deleted`,
  restorableFor7Days: "It can be restored for 7 days.",
  undo: "Undo",
  theListCouldNotBeLoaded: "The list could not be loaded",
  noRecordingYet: "No recordings yet",
  noRecordingHint: "Press Record to record all devices, or upload logs and captures; they can also be dropped here.",
  noMatches: "No matches",
  noMatchesHint: "Remove a filter or search term.",
  recordingsNewestFirst: "Recordings, newest first",
  motion: "Motion",
  recording: "Recording",
  recordingNow: "recording now",
  detailsOf: (title: Value) => `Details of ${title}`,

  // markers
  addMarkerHere: "Add a marker here",
  addMarkerHereHint: "Add a marker here (M)",
  noMarkers: "No markers yet. Press M or + to add one at the playhead.",
  note: "note",
  marker: "marker",
  markerAt: (at: Value) => `Marker at ${at}`,
  discardMarker: "Discard the marker",

  // open page
  recordingId: (id: Value) => `Recording ${id}`,
  openingId: (id: Value) => `Opening ${id}`,
  checkingCache: "Checking the cache…",
  openedShare: (share: Value) => `Opened ${share} %`,
  cannotBeOpened: "The recording cannot be opened",
  toLibrary: "To the library",

  // overview strip
  overviewLabel: "Entire recording: motion, losses, worst status, markers and loop",
  worstStatus: "Worst status",

  // replay page
  wholeRecording: "Entire recording",
  decodeProgress: "Decoding progress",
  firstDecode: "Decoding for the first time. The part already decoded can be viewed.",
  damagedFilter: "Damaged",
  backToTheLibrary: "Back to the library",
  recordingFacts: (started: Value, length: Value, size: Value, unit: Value) =>
    `${started} UTC · ${length} · ${size} ${unit}`,

  // settings
  asRecordedHint: "Settings of the device at the time of recording",
  asRecorded: "As recorded",
  recordingTitle: (title: Value) => `Recording ${title}`,
  settingsAsRecorded: "Settings as recorded",
  compareHint: "Saves these settings as a snapshot of the device and compares them with its current ones",
  compareWithNow: (name: Value) => `Compare with ${name} now`,
  compareUnavailable:
    "The device is not connected. Connect it to compare these settings with its current ones or to write them again.",
  readingRecordedSettings: "Reading the settings…",
  settingsNotRead: (settings: number, titles: Value) => `${count(settings, "setting")} could not be read: ${titles}.`,

  // share menu
  inView: "In view",
  loopRange: "Loop range",
  share: "Share",
  copyLinkToView: "Copy a link to this view: recording, range, cursor, plots (C)",
  playLiveHint: "Play as a live device that all users see, at the pace at which the bytes arrived",
  asDevice: "As device",
  keepRange: "Keep this range",
  keepBetweenCursors: "Keep A to B",
  keepRangeHint: "Make a recording of the range in view, or between the cursors A and B, with its bytes",
  rangeOf: (title: Value, from: Value, to: Value) => `${title}, ${from} to ${to}`,

  // head on a phone
  deviceOfRecording: "Device on screen",

  // thumbnail
  lostInPlaces: (losses: number) => `, samples lost in ${count(losses, "place")}`,
  motionOverTheRecording: (lost: Value) => `Motion over the recording${lost}`,

  // transport
  playback: "Playback",
  toStart: "Go to the start (Home)",
  play: "Play",
  withSpaceKey: (action: Value) => `${action} (Space)`,
  playhead: "Playhead",
  loopView: "Loop the visible range",
  loopViewHint: "Loop the visible range (L); Shift-drag on the overview to select a range",
  rangeOfLoop: (t0: Value, t1: Value) => `${t0} to ${t1}`,
  loop: "Loop",
  followHint: "Keep the playhead in view during playback",
  follow: "Follow",
  fitAll: "Show the entire recording (F)",
  speedHint: "Playback speed",
  speed: "Speed",
  timeAxisOf: (base: "device" | "arrival") => `Time axis: ${base} time`,
  deviceTimeOrArrivalTimeT: "Device time or arrival time (T)",
  moreActions: "Export, link, markers, devices",

  // api
  uploadFailed: (name: Value) => `${name} could not be uploaded.`,
  checkServer: "Check that the server is running, then try again.",
  fileNotAdded: (name: Value) => `${name} was not added.`,

  // export formats

  // library filter
  pinned: "Pinned",
  withLoss: "With loss",
  rejectCount: (rejects: number) => count(rejects, "reject"),
  deleted7Days: "Deleted, 7 days",
  damagedTag: "damaged",

  // window fetcher
  showingEarlier: "Showing earlier data; retrying.",
  reloadPage: "Reload the page; it may be older than the server.",
};
