/** Texts of Configure. */
import { count } from "./plural";
import type { Value } from "../wire/texts";

export const TEXT = {
  // apply bar
  progress: "Progress",
  changesToWrite: "Pending changes",
  changeCount: (total: number) => count(total, "change"),
  inTitles: (titles: Value) => `in ${titles}`,
  andMore: (more: Value) => ` and ${more} more`,
  temporaryChange: "Temporary: reverts unless confirmed.",
  linkAfterwards: (share: Value, rate: Value) => `Link: ${share} % of ${rate} Bd`,
  snapshotBeforeWrite: "A snapshot is saved first; values are verified after writing.",
  reasonLabel: "Reason, saved with the snapshot",
  reasonPlaceholder: "Reason (optional)",
  undoLastEdit: "Undo the last edit",
  undoHint: "Undo (Ctrl Z)",
  discardAll: "Discard all",
  writeResult: "Write result",
  ok: "OK",
  editAgain: "Edit again",
  confirmWrite: "Write these changes?",
  confirmCommand: (title: Value) => `Send “${title}”?`,
  writeThenConfirm: "Write, then confirm",
  write: "Write",

  // command form
  viewOnlyCommand: "View only. To send commands, open this page with a control token.",
  invalidValues: "Some values are invalid.",
  readBeforeCommand: "Read the settings first; the form starts from the device's values.",
  request: "Request",
  send: "Send",
  answeredBy: (reply: Value) => `Reply: ${reply}.`,
  noReply: "The device sends no reply.",
  cannotBeUndone: "This cannot be undone.",

  // compare
  chooseFile: "Choose a snapshot file downloaded from this or another imuscope.",
  deviceNotRead: "The device has not been read yet.",
  compare: "Compare",
  left: "Left",
  swapSides: "Swap sides",
  right: "Right",
  valuesCannotBeWritten: (right: Value, problems: number) => `${right}: ${count(problems, "value")} cannot be written`,
  side: (label: Value) => `${label} side`,
  deviceAsLastRead: "Device, as last read",
  factoryDefault: "Factory default",
  file: (name: Value) => `File ${name}`,
  fileChoice: "File…",
  fileTooLarge: "The file is too large for a snapshot. Choose one downloaded from imuscope.",
  openFile: "Open a file",
  noDifference: "No difference",
  differenceCount: (rows: number) => count(rows, "difference"),
  valuesAgree: (same: number) => `, ${count(same, "value")} agree.`,
  setting: "Setting",
  missing: "missing",
  settingsNotCompared: (missing: number) => `${count(missing, "setting")} could not be compared`,

  // confirm dialog
  leaveUnchanged: "Leave unchanged",

  // empty states
  notReadYet: "Not read yet",
  settingsUnknown: (name: Value) =>
    `The settings of ${name} are unknown. Read them from the device; they are saved as a snapshot.`,
  alsoUsedBy: (programs: Value) => `Also used by ${programs}, so imuscope reads the settings only on request.`,
  readSettings: "Read settings",
  readingSettings: "Reading the settings…",
  noSettingsToShow: "No settings to show",
  loadingForms: "Loading forms",
  protocolUnknown: "Protocol unknown",
  formsLoading: "The forms of this device are loading.",
  waitingForProtocol: "Waiting for protocol detection.",
  tryAgain: "Try again",
  viewTokenHint: "This page was opened with a view token. To change settings, open it with a control token.",
  lastReadValues: "Showing the values last read. Edits are retained until they can be written.",
  restoreCommunication: "Restore communication",
  anotherSensor: "Another sensor",
  putAside: (of: Value, now: Value, total: number) =>
    `This is ${now}. Edits of ${count(total, "setting")} for ${of} are stored until it is back.`,
  notConfirmed: "Sensor not confirmed",
  mayBeAnother: (serial: Value, time: Value) =>
    `Nothing came from it until ${time}. Whether this is still ${serial} is known once its settings are read.`,
  unreadSettings: (total: number) => `${count(total, "setting")} could not be read`,
  changedElsewhere: "Changed elsewhere",
  editedHereToo: "You edited this as well; the form retains your value.",
  editsRebased: "Your edits are retained and now apply to the device's current values.",
  dismiss: "Dismiss",
  notFinished: "Incomplete",

  // group
  commands: "Commands",
  read: "Read",
  action: "Action",
  noSettings: (device: Value) => `${device} has no settings: it only sends.`,
  framesToSend:
    "Each entry below sends a frame to the device, which is for the test of a receiver. Nothing here reads from it.",
  toTheDevice: "sent to the device",

  // jobs
  queued: "queued",
  running: "running",
  stopped: "Stopped.",
  done: "Done.",
  removeFromQueue: "Remove",
  differences: "Differences from the request",
  alteredMark: "▲ altered",
  rejectedMark: "■ rejected",
  alteredValue: (requested: Value, actual: Value) => `requested ${requested}, the device has ${actual}`,
  noAnswer: "no reply",
  nothing: "nothing",

  // model
  viewOnlyChange: "View only. To change settings, open this page with a control token.",
  deviceUnreachable: "The device is unreachable.",

  // page
  skipToTheForm: "Skip to the form",
  restoreIntro:
    "For a device that no longer replies at any baud rate. The port stays open; nothing is sent until you start.",
  settingNotFound: (name: Value) => `This device has no setting or command “${name}”. Select one from the list.`,
  notFound: "Not found",
  detailLevel: "Level of detail",
  basic: "Basic",
  readAllHint: "Read all settings from the device",
  readAgain: "Read again",

  // restore
  startStep: "Start.",
  restoreCalls: "The server sends the documented recovery sequence repeatedly.",
  startAgain: "Start again",
  startRestore: "Start",
  powerCycleStep: "Power-cycle the device: off for two seconds, then on.",
  powerCycleReason: "It accepts the sequence only while it starts.",
  deviceRepliesStep: "The device replies",
  restoreResult: "with its factory communication settings, and its previous settings are restored.",

  // rollback banner
  aDevice: "A device",
  applyingTheNewSettings: "Applying the new settings",
  rollingBack: "Rolling back",
  confirmed: "Confirmed",
  rolledBack: "Rolled back to the previous settings",
  temporarySettings: "Temporary settings",
  confirmNewSettings: ": confirm the new settings",
  confirmUnavailable:
    "The server is unreachable, so the change cannot be confirmed now. It reverts unless already confirmed.",
  rollBackNow: "Roll back now",
  confirm: "Confirm",
  unreachableLabel: "The device is unreachable",
  unreachableUntilPowerCycle: ": unreachable until power cycle",
  restoreHint: "Use “Restore communication” on its page.",
  later: "Later",

  // rollout
  sent: "Sent",

  // setting form
  effectAfterMeasurement: "Takes effect when measurement restarts.",
  effectAfterRestart: "imuscope restarts the device after the write, which puts it into effect.",
  readAgainHint: (problem: Value, pause: Value) =>
    [problem, pause, "Use “Read again” to query the device."].filter((one) => one !== "").join(" "),
  notReadFromDevice: "Not read from this device yet.",
  notReadFromThisDevice: (why: Value) => `Not read from this device: ${why}.`,
  discardChanges: (edits: number) => `Discard ${count(edits, "change")}`,
  makeFit: "Fit to link",
  temporary: "▲ temporary",
  fits: "The outputs already fit.",
  loweredToFit: "Rates lowered:",

  // sidebar
  closeSettingsList: "Close the settings list",
  snapshotNote: "A snapshot is saved by serial number before every write.",
  deviceState: (word: Value) => `Device, ${word}`,
  searchSettingsAndCommands: "Search settings and commands",
  searchSettings: (settings: number) => `Search ${count(settings, "setting")}`,
  noMatch: "No matches.",
  matches: "Matches",
  command: "command",
  settingGroups: "Setting groups",
  changedCount: (edits: Value) => `${edits} changed`,
  changed: "changed",
  snapshots: "Snapshots",

  // sides
  beforeThisChange: "Before this change",
  readFromTheDevice: "Read from the device",

  // snapshot
  confirmDelete: (title: Value) => `Delete “${title}”?`,
  snapshotDeleteHint: "The snapshot is deleted; the device is not changed.",
  deleteSnapshot: "Delete snapshot",
  settingCount: (settings: number) => `· ${count(settings, "setting")}`,
  missingCount: (missing: Value) => `, ${missing} missing`,
  view: "View",
  saveAs: "Save as…",
  saveAsHint: "Save these settings under a name",
  namePlaceholder: "New mast fitted",

  // traffic log
  queueEmpty: "Queue empty. Commands run one at a time per device.",

  // view state
  confirmRead: "Read the settings now?",
  readAndDiscard: "Read and discard",
  restartsTheDevice: "restarts the device",
  stopsItsOutput: "stops its output",
  canCutLink: "can interrupt the link",
  losesSettings: "erases settings",
  writesFlashMemory: "writes flash memory",
  changesMeaning: "changes the meaning of the data",
};
