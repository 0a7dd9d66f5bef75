/** Texts of the dialog that makes evidence. Those of the file itself are in viewer/texts.ts. */
import type { Value } from "../../wire/texts";

export const TEXT = {
  evidence: "Evidence…",
  word: "Evidence",
  title: (name: Value) => `Evidence of ${name}`,
  live: "Live",
  hintOfButton: "Plots, cursors, figures and notes as one file that opens without a network (E)",
  part: "Part to show",
  inView: "In view",
  betweenCursors: "A to B",
  whole: "Whole recording",
  allInMemory: "All in memory",
  what: "One HTML file of at most 20 MB: the plots on screen with both cursors, figures over all samples, notes, events, device settings, losses and versions. It opens from disk in any browser, without a network.",
  fromMemory: "The server first saves its memory of that time as a recording.",
  leaveOut: "Leave out position",
  leaveOutHint:
    "Without latitude, longitude, altitude, coordinates, GNSS data and reference locations. Numbers near the place are removed from the title, notes and events; names of places are not.",
  without: (count: Value) => `${count} not computed by the server; the file is without.`,
  make: "Make the file",
  key: "Evidence: plots, cursors, figures and notes as one file",
  making: "Saving from memory…",
};
