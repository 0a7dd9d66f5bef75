/** Types of what the server can do. Generated from server/wire/capabilities.py by `python -m imuscope.server.generators.ts_types`; do not edit. */

export type DecodeOptionKind = "text" | "choice" | "flag" | "secret" | "file";

export interface DecodeOptionChoice {
  readonly value: string;
  readonly words: string;
}

/** An option of how the bytes of a device are decoded, set by the user. */
export interface DecodeOptionInput {
  /** as in the request that sets it */
  readonly name: string;
  readonly title: string;
  /** a secret is typed unseen, and never returned */
  readonly kind: DecodeOptionKind;
  /** of a choice; an empty value: not given */
  readonly choices: readonly DecodeOptionChoice[];
  /** in effect if the option is not set */
  readonly default: string;
  /** also offered while the protocol is not known */
  readonly early: boolean;
  /** regular expression of the whole text; "" for any */
  readonly pattern: string;
  /** error if the text does not match */
  readonly malformed: string;
  /** one that does */
  readonly example: string;
}

/** A number that a payload can consist of. */
export interface PayloadNumber {
  /** "i16" */
  readonly name: string;
  /** in bytes */
  readonly size: number;
}

/** Registered protocol family: its names, options and simulator. */
export interface ProtocolCapability {
  /** "xbus" */
  readonly name: string;
  /** "Xsens MTi (Xbus)" */
  readonly title: string;
  /** short title: "Xbus" */
  readonly short: string;
  /** `sim:NAME` is a simulated device */
  readonly simulator: boolean;
  readonly options: readonly DecodeOptionInput[];
  /** option by which the user describes a vendor's own payload types; "" for none */
  readonly payload_option: string;
  readonly payload_template: string;
  /** the first whose size fits is the {type} */
  readonly payload_numbers: readonly PayloadNumber[];
  /** outputs to enable for an attitude */
  readonly attitude_hint: string;
  /** why a device has no name yet, and how to get it */
  readonly identify_hint: string;
  /** effect of reading its settings */
  readonly pause_hint: string;
  /** parts of its names to write in capitals */
  readonly abbreviations: readonly string[];
  /** titles or names of quantities to plot first */
  readonly plots: readonly string[];
  /** ids of panels to place first */
  readonly panels: readonly string[];
  /** its samples are numbered, so that lost ones are known */
  readonly counts_losses: boolean;
  /** name of the channel that has the numbers, where a device can be set not to send it */
  readonly counter: string;
}

/** A format that recordings can be exported to. */
export interface ExportCapability {
  /** "csv" */
  readonly name: string;
  /** "CSV" */
  readonly title: string;
  /** "full precision, units, one table per message" */
  readonly words: string;
  /** ".csv" */
  readonly suffix: string;
  /** holds the bytes of one device, and no choice of channels */
  readonly single: boolean;
  /** only for devices with this protocol; "" for any */
  readonly protocol: string;
  /** rough size, for each byte of the recording, until it is measured */
  readonly per_byte: number;
}

export interface SourceExample {
  /** "tcp://192.168.1.20:2000" */
  readonly source: string;
  /** "a serial server or a device on the network" */
  readonly words: string;
}

/** Registered kind of link, with the form of its addresses. */
export interface LinkCapability {
  /** DeviceInfo.link: "tcp" */
  readonly name: string;
  /** as displayed: "TCP" */
  readonly title: string;
  readonly examples: readonly SourceExample[];
  /** its port can be shared with other programs */
  readonly shareable: boolean;
  /** messages of its sources are numbered, so that lost ones are known */
  readonly counts_messages: boolean;
}

/** An extension whose packages are not installed. */
export interface AbsentExtension {
  /** "rerun" */
  readonly name: string;
  /** "Rerun" */
  readonly title: string;
  /** the command that adds it: "pip install 'imuscope[viewers]'" */
  readonly install: string;
}

/** Everything that can be added without changing the page. */
export interface Capabilities {
  readonly protocols: readonly ProtocolCapability[];
  readonly exports: readonly ExportCapability[];
  readonly links: readonly LinkCapability[];
  readonly absent: readonly AbsentExtension[];
}
