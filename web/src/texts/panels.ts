/** Texts of the panels beside and below the plots. */
import { count, plural } from "./plural";
import type { Value } from "../wire/texts";

export const TEXT = {
  // authenticity
  trust: {
    verified: "verified",
    unverified: "unverified",
    "partly protected": "partly protected",
    "not protected": "not protected",
  },
  noKey: "no key",
  wrongKeyOrForged: "wrong key or forged frame",
  headerChecksumError: "header checksum error",
  crc32Error: "CRC-32 error",
  modeTooWeak: "security mode too low",
  oldSequenceNumber: "old sequence number",
  sequenceNumberFarAhead: "sequence number far ahead",
  unknownId: "unknown identifier",
  otherVersion: "unsupported version",
  unknownMode: "unknown mode",
  successorProtocol: "successor protocol",
  invalidNmea: "invalid NMEA sentence",
  rejectedWithoutKey: (frames: number) => `${count(frames, "Secure frame")} rejected: no key to verify them.`,
  rejectedByKey: (frames: number) => `${count(frames, "Secure frame")} rejected: the key does not match.`,

  // event groups
  alarms: "Alarms",
  lossAndClock: "Loss and clock",
  deviceAndLink: "Device and link",
  commandsAndReplies: "Commands and replies",
  thenSamplesLost: (samples: number) => `, ${count(samples, "sample")} lost`,
  gapsBecause: (gaps: number, lost: Value, cause: Value) => `${count(gaps, "gap")}${lost}: ${cause}`,
  framesRejected: (frames: number, times: Value, cause: Value) =>
    `${count(frames, "frame")} rejected, ${times} times; most recent: ${cause}`,
  repeated: (text: Value, times: Value) => `${text} (${times} times)`,

  // event list
  level: { info: "note", warning: "warning", error: "error" },
  eventFilter: "Event filter",
  noEvents: "No events yet.",
  noMatchingEvents: "No events of this type.",
  showLastOfGroup: (n: number, from: Value, to: Value) =>
    `${count(n, "time")}, ${from} to ${to} UTC. Show the most recent on the plots.`,
  showOnPlots: "Show on the plots",
  events: "Events",
  newestFirst: "newest first",

  // health panel
  samples: "Samples",
  samplesHelp: "Rate of the fastest message over the last second",
  gaps: "Gaps",
  gapsHelp: "Samples missing in the last minute by the device's counter, and link downtime",
  rejectsHelp: "Frames in the last minute that failed verification; excluded from the data",
  bytesHelp: "All bytes received over the last second",
  shareOfLink: "Share of link",
  shareHelp: "Bytes per second relative to the link capacity",
  arrivalJitter: "Arrival jitter",
  jitterHelp: "99th percentile of arrival delay relative to the device clock",
  lastSample: "Last sample",
  lastSampleHelp: "Time since the newest sample arrived at the host",
  droppedHere: "Dropped here",
  droppedHelp: "Samples not sent to this browser because it did not take them in time",
  clockDrift: "Clock drift",
  driftHelp: "Device clock relative to the host clock",
  unevenCause: "Cause",
  evenAgain: "Samples arrive evenly again.",
  deviceTimeHelp: "Uncertainty of device times on the host clock",
  boundHolds: (presumed: string) => `± of times holds ${presumed}.`,
  timesUnknown: (why: string) => `The uncertainty of times is unknown: ${why}.`,
  sinceStart: "since the start",
  headerChecked: "header checked",
  samplesPerSecond: "samples/s",
  rejectsUnit: "rejects",
  oldUnit: "old",
  samplesUnit: "smp",
  samplesLost: "samples lost",
  ofLink: "% of link",
  msJitter: "ms jitter",
  msDeviceTime: "ms device time",
  agoSuffix: " ago",
  health: "Health",
  lastMinute: "last minute",
  linkHealth: "Link health",

  // health text
  samplesShort: (lost: Value) => `${lost} smp`,
  framesUnit: (frames: number) => plural(frames, "frame"),
  sinceSessionBegan: (gaps: number, lost: number, rejects: number, unclaimed: number) =>
    `Since the session began: ${count(gaps, "gap")}, ${count(lost, "sample")} lost, ${count(rejects, "frame")} rejected${unclaimed > 0 ? `, ${count(unclaimed, "byte")} in no accepted message` : ""}.`,
  behindBy: (value: Value, unit: Value, cause: string) => `Behind by ${value} ${unit}: ${cause}.`,
  behindIn: {
    link: "bytes arrive late on the link",
    decoding: "decoding on the server is late",
    connection: "samples arrive late from the server",
    page: "this page processes samples late",
  },
  behindReason: {
    others: "the server's computer is busy",
    decoding: "decoding takes all the time of a processor core",
  },
  behindPart: { link: "Link", decoding: "decoding", connection: "connection", page: "page" },
  behindRemedy: {
    link: "Check the link: its network, or the load of the computer that reads it.",
    decoding:
      "Recordings and shared ports are served first. Reduce the load of the server's computer, or send at lower rates.",
    connection: "Use a faster network, or open fewer panels.",
    page: "Close other tabs, or open fewer panels.",
  },
  msP99: "ms p99",
  unitAgo: (unit: Value) => `${unit} ago`,
  droppedVerdict: (samples: number) =>
    `${count(samples, "sample")} not sent to this browser because it did not take them in time.`,
  gapVerdict: (t0: Value, text: Value) => `Gap ${t0}: ${text}`,
  rejectsVerdict: (frames: number) =>
    `${count(frames, "frame")} failed verification and ${plural(frames, "was", "were")} discarded.`,
  noneMissing: "No sample is missing by the device's counter.",
  lostBeforeVerdict: (samples: number) =>
    `${count(samples, "sample")} lost since the session began, before the events in memory.`,
  behindVerdict: "Losses in that time are not known yet.",
  noSamplesYet: "No samples yet: nothing is known about loss.",
  lossesWithout: (counter: string) =>
    `The device does not send ${counter}: lost samples cannot be counted. Enable it in its outputs.`,
  lossesUnnumbered: "The samples have no numbers: lost ones cannot be counted.",
  lostLaterVerdict: (samples: number) =>
    `No loss up to here; ${count(samples, "sample is", "samples are")} missing later.`,
  noLossInSession: "No loss since this session began.",
  noLossInRecording: "No loss in this recording.",
  lossesUnknown: "The publisher does not number its messages: lost ones cannot be counted.",

  // value groups
  otherValues: "Other values",

  // values
  mean: "mean",
  meanOf: (stretch: Value) => `mean ${stretch}`,
  fromAToB: "A–B",
  reading: { now: "now", cursor: "cursor", paused: "paused" },
  valuesLabel: "Values of the selected device",
  heldFor: (value: Value, unit: Value) => `held, ${value} ${unit} old`,
  atTime: (time: Value, offScreen: Value) => `at ${time}${offScreen}`,
  ageOf: (age: Value) => `${age} ago`,
  windowLength: (value: Value, unit: Value) => `${value} ${unit} window`,
  showRowsOf: (label: Value) => `Show the rows of ${label}`,
  show: "Show",
  values: "Values",

  // values
  offScreen: ", off screen",
};
