/** For tests: a minimal protocol of a server. */
import type { ProtocolCapability } from "../wire/capability-types";

export function protocol(part: Partial<ProtocolCapability> & { readonly name: string }): ProtocolCapability {
  return {
    title: part.name,
    short: part.name,
    simulator: false,
    options: [],
    payload_option: "",
    payload_template: "",
    payload_numbers: [],
    attitude_hint: "",
    identify_hint: "",
    pause_hint: "",
    abbreviations: [],
    plots: [],
    panels: [],
    counts_losses: false,
    counter: "",
    ...part,
  };
}
