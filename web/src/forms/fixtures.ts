/** For the tests of the forms: a field, a setting, a command with everything at its plainest. */
import type { CommandForm, FieldForm, Forms, SettingForm } from "./types";

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
    step: null,
    default: null,
    decimals: -1,
    length: 0,
    max_length: 0,
    axes: [],
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
    editor: "",
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
    outputs: [],
    streams: [],
    corrections: false,
    factory: false,
    note: "",
    ...part,
  };
}
