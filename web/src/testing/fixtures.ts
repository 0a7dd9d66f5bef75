/** For tests: a field, a setting, a command, a channel and its columns, an event with everything at its plainest. */
import type { CommandForm, FieldForm, Forms, RateRow, RateTable, SettingForm } from "../wire/form-types";
import type { ChannelInfo, ColumnInfo, EventInfo } from "../wire/types";

export function columnInfo(part: Partial<ColumnInfo> = {}): ColumnInfo {
  return {
    name: "value",
    dtype: "f4",
    unit: "",
    sent_unit: "",
    label: "",
    axis: "",
    choices: {},
    bits: [],
    decimals: -1,
    period: 0,
    doc: "",
    ...part,
  };
}

/** A channel with the given columns; its title is its name. */
export function channelInfo(part: Partial<ChannelInfo> = {}): ChannelInfo {
  return {
    id: 1,
    device: "1",
    message: "MTData2",
    name: "N",
    title: part.name ?? "N",
    kind: "scalar",
    unit: "",
    frame: "",
    columns: [],
    doc: "",
    source: "",
    group: "",
    verified: true,
    ...part,
  };
}

export function eventInfo(part: Partial<EventInfo> = {}): EventInfo {
  return {
    ...{
      seq: 1,
      time: 0,
      device: "1",
      kind: "text",
      level: "info",
      text: "",
      t0: null,
      t1: null,
      samples: 0,
      data: {},
    },
    ...part,
  };
}

export function field(part: Partial<FieldForm> = {}): FieldForm {
  return {
    name: "value",
    title: "Value",
    editor: "number",
    unit: "",
    scale: 1,
    bias: 0,
    low: null,
    high: null,
    limited: [],
    step: null,
    default: null,
    decimals: -1,
    length: 0,
    max_length: 0,
    axes: [],
    frame: "",
    choices: {},
    bits: [],
    fields: [],
    basic: true,
    read_only: false,
    base: 10,
    options: [],
    listed: null,
    meaning_of: "",
    meanings: [],
    doc: "",
    source: "",
    ...part,
  };
}

export function setting(part: Partial<SettingForm> = {}): SettingForm {
  return {
    name: "Setting",
    title: "Setting",
    group: "Group",
    fields: [],
    writable: true,
    partial: false,
    table: null,
    after: "",
    caution: "",
    consequence: "",
    basic: true,
    doc: "",
    source: "",
    ...part,
  };
}

export function command(part: Partial<CommandForm> = {}): CommandForm {
  return {
    name: "Command",
    title: "Command",
    group: "Group",
    kind: "do",
    arguments: [],
    reply: "",
    caution: "",
    consequence: "",
    basic: true,
    doc: "",
    source: "",
    harmless: {},
    writes: "",
    ...part,
  };
}

export function forms(part: Partial<Forms> = {}): Forms {
  return {
    protocol: "xbus",
    product: "MTi-680",
    serial_number: "",
    firmware: "",
    groups: ["Group"],
    settings: [],
    commands: [],
    corrections: false,
    factory: false,
    axes: "FLU",
    note: "",
    ...part,
  };
}

const TABLE: RateTable = {
  key: "data_identifier",
  rate: "output_frequency",
  heading: "Data",
  rows: [],
  key_mask: 0xfff0,
  key_digits: 4,
  every: 0xffff,
  interval: "",
  divisors: [],
  variants: [
    {
      name: "precision",
      title: "Precision",
      mask: 3,
      choices: ["Float32", "Fp12.20", "Fp16.32", "Float64"].map((words, bits) => ({ bits, words })),
      fixed: "fixed",
    },
    {
      name: "frame",
      title: "Frame",
      mask: 0xc,
      choices: ["ENU", "NED", "NWU"].map((words, at) => ({ bits: at << 2, words })),
      fixed: "",
    },
  ],
  grouped: false,
};

/** A table of rates in Hz, with variants in the key. */
export const OUTPUTS = TABLE;

/** A table of divisors. */
export const STREAMS: RateTable = {
  ...TABLE,
  key: "did",
  rate: "period",
  heading: "Data set",
  key_mask: 0xffff,
  key_digits: 0,
  every: 0,
  interval: "source_ms",
  divisors: [1, 2, 5, 10],
  variants: [],
  grouped: true,
};

export function tableRow(id: number, title: string, part: Partial<RateRow> = {}): RateRow {
  return { id, title, group: "", name: "", rates: [], variants: {}, interval_ms: 0, basic: true, doc: "", ...part };
}

/** A setting whose only field is a list of outputs with their rates. */
export const OUTPUT_SETTING = setting({
  name: "OutputConfiguration",
  table: OUTPUTS,
  fields: [
    field({
      name: "outputs",
      editor: "list",
      fields: [field({ name: "data_identifier" }), field({ name: "output_frequency" })],
    }),
  ],
});

export const outputsOf = (...pairs: [number, number][]) => ({
  outputs: pairs.map(([data_identifier, output_frequency]) => ({ data_identifier, output_frequency })),
});
