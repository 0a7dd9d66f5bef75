/** Texts of the panel of satellites. */
import type { Value } from "../../wire/texts";

export const TEXT = {
  satellites: "Satellites",
  satellitesLabel: "Satellites by constellation, with signal strength in dB-Hz",
  system: (value: Value) => `System ${value}`,
  inDBHz: " in dB-Hz",
};
