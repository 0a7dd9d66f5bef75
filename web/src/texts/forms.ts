/** Texts of forms: fields, tables, add a device. */
import { count } from "./plural";
import type { Value } from "../wire/texts";

export const TEXT = {
  // alignment
  angles: "Roll, pitch, yaw",
  anglesHelp: "The same rotation as angles: about z, then y, then x.",
  rollAxis: "roll",
  pitchAxis: "pitch",
  yawAxis: "yaw",
  upright: "Upright",
  upsideDown: "Upside down",
  mountedAs: "Sensor is mounted",

  // add device
  example: (text: Value) => `Example: ${text}.`,
  no: "No",
  yes: "Yes",
  decodeOptions: "Decoding options",
  address: "Address",
  addressPlaceholder: "/dev/ttyUSB0",
  protocol: "Protocol",
  detectAutomatically: "Detect automatically",
  add: "Add",
  useKey: "Use this key",
  examples: "Examples",

  // budget bar
  linkBudget: "Link budget",
  ofBaudRate: (rate: Value) => `% of ${rate} Bd`,
  ofLink: "% of the link",
  measuredRate: (measured: Value) => `measured ${measured} B/s`,
  rateBefore: (total: Value) => `before ${total} B/s`,
  now: ", now",
  link: "Link",

  // budget
  outputsNeedShare: (percent: Value) => `The outputs need ${percent} % of the link.`,

  // elsewhere
  offToOn: "off → on",
  onToOff: "on → off",

  // choice table
  on: "On",
  load: "Load",
  changed: "Changed",
  offInTable: "off",

  // field
  wasValue: (field: Value) => `was ${field}`,

  // frame view
  framePreview: "Frame preview",
  frameCount: (frames: number) => (frames === 1 ? "Frame" : count(frames, "frame")),
  bytesToTheDevice: (bytes: number) => `${count(bytes, "byte")} to the device`,
  changedBytesUnderlined: ", changed bytes underlined",
  copyHex: "Copy hex",
  moreFrames: (frames: number) => `… and ${count(frames, "more frame")}.`,

  // inputs
  notRead: "not read",
  undocumentedValue: (value: Value) => `${value} (undocumented)`,
  off: "Off",
  numbersOfField: (title: Value, n: number) => `${title}, ${count(n, "number")}`,
  problemOfNumber: (n: Value, problem: Value) => `Number ${n}: ${problem}`,
  wrongNumberCount: (expected: number, given: Value) => `Enter ${count(expected, "number")}; there are ${given}.`,

  // list input
  noEntry: "No entries.",
  newEntry: "new",
  thisLink: "this link",
  perhapsThisLink: "perhaps this link",
  entryInSentence: (place: Value) => `entry ${place}`,
  moveEntryUp: (n: Value) => `Move entry ${n} up`,
  moveEntryDown: (n: Value) => `Move entry ${n} down`,
  removeEntry: (place: Value) => `Remove entry ${place}`,
  atMostEntries: (most: number) => `At most ${count(most, "entry", "entries")}`,
  addEntry: "Add an entry",
  entry: (place: Value) => `Entry ${place}`,

  // outputs table
  id: "ID",
  rate: "Rate",
  rateOf: (title: Value) => `Rate of ${title}`,
  variantOf: (variant: Value, title: Value) => `${variant} of ${title}`,

  // outputs
  everySample: "every sample",
  highestRate: (most: Value) => `highest, ${most} Hz`,
  unknownOutput: "Not in the table",
  wasOff: "was off",
  wasChoice: (choice: Value) => `was ${choice}`,
  wasParts: (parts: Value) => `was ${parts}`,

  // streams
  nativeRate: "native rate",
  oneIn: (period: Value) => `1 in ${period}`,

  // values
  numberRequired: "Enter a number.",
  notANumber: "Not a number. Enter digits, with a point for decimals.",
  wholeNumberRequired: "Enter a whole number.",
  numberTooLarge: "The number is too large",
  numberRange: (low: Value, high: Value, unit: Value) => `${low} to ${high}${unit}`,
  atLeast: (low: Value, unit: Value) => `at least ${low}${unit}`,
  atMost: (high: Value, unit: Value) => `at most ${high}${unit}`,
  entryCount: (entries: number) => count(entries, "entry", "entries"),
  atMostBytes: (most: number) => `At most ${count(most, "byte")}.`,
  atMostCharacters: (most: number) => `At most ${count(most, "character")}.`,
};
