/** The fields of the form of an alarm, and the definition in them. */
import type { AlarmDraft } from "./states";
import type { AlarmDefinition, DeviceFilter } from "../../wire/routes";
import type { DeviceInfo } from "../../wire/types";
import { type RecordingFields, recordingFieldsOf, recordingOf } from "./recording-choice";
import { TEXT } from "./texts";

type Kind = AlarmDefinition["condition"]["kind"];
export type HealthFigure = keyof typeof TEXT.figures;

/** The fields of the form, as typed. */
export interface AlarmFields {
  readonly name: string;
  readonly kind: Kind;
  readonly expression: string;
  readonly clear: string;
  readonly signal: string;
  readonly flag: string;
  readonly isSet: boolean;
  readonly figure: HealthFigure;
  readonly limit: string;
  readonly level: "warning" | "error";
  readonly raise: string;
  readonly clearAfter: string;
  readonly latched: boolean;
  readonly enabled: boolean;
  readonly devices: DeviceFilter;
  readonly webhook: string;
  readonly recording: RecordingFields | undefined;
}

/** The fields for a draft: a stored alarm, an expression to start from, or a new one. */
export function fieldsOf(draft: AlarmDraft, device: DeviceInfo | undefined): AlarmFields {
  const { definition } = draft;
  const condition = definition?.condition;
  return {
    name: definition?.name ?? "",
    kind: condition?.kind ?? "expression",
    expression: condition?.kind === "expression" ? condition.expression : (draft.expression ?? ""),
    clear: condition?.kind === "expression" ? condition.clear : String(conditionClear(condition)),
    signal: condition?.kind === "flag" ? condition.signal : "",
    flag: condition?.kind === "flag" ? condition.flag : "",
    isSet: condition?.kind === "flag" ? condition.is_set : true,
    figure: condition?.kind === "health" ? condition.figure : "silence",
    limit: condition?.kind === "health" ? String(condition.limit) : "1",
    level: definition?.level ?? "warning",
    raise: String(definition?.raise_s ?? 0),
    clearAfter: String(definition?.clear_s ?? 0),
    latched: definition?.latched ?? false,
    enabled: definition?.enabled ?? true,
    devices: definition?.devices ?? { ...ANY, device: device === undefined ? "" : lastingName(device) },
    webhook: definition?.webhook ?? "",
    recording: recordingFieldsOf(definition?.recording),
  };
}

function conditionClear(condition: AlarmDefinition["condition"] | undefined): string {
  return condition?.kind === "health" && condition.clear !== null ? String(condition.clear) : "";
}

/** The filter that every device passes. */
export const ANY: DeviceFilter = { device: "", product: "", family: "" };

/** What names a device also after a restart of the server. */
export function lastingName({ serial_number, source }: DeviceInfo): string {
  return serial_number || source;
}

/** The definition in the fields; of a stored alarm what the form does not have stays. */
export function definitionOf(fields: AlarmFields, before: AlarmDefinition | undefined): AlarmDefinition {
  return {
    ...before,
    name: fields.name.trim() || alarmName(fields),
    condition: conditionOf(fields),
    devices: fields.devices,
    level: fields.level,
    raise_s: Number(fields.raise) || 0,
    clear_s: Number(fields.clearAfter) || 0,
    latched: fields.latched,
    enabled: fields.enabled,
    webhook: fields.webhook.trim(),
    recording: recordingOf(fields.recording),
  };
}

function conditionOf(fields: AlarmFields): AlarmDefinition["condition"] {
  const { kind, figure, limit } = fields;
  if (kind === "expression") return { kind, expression: fields.expression.trim(), clear: fields.clear.trim() };
  if (kind === "flag") return { kind, signal: fields.signal, flag: fields.flag, is_set: fields.isSet };
  const clear = fields.clear.trim() === "" ? null : Number(fields.clear);
  return { kind, figure, limit: Number(limit) || 0, clear: figure === "link" ? null : clear };
}

/** The name of an alarm that was given none. */
export function alarmName({ kind, expression, flag, figure }: AlarmFields): string {
  const text = kind === "expression" ? expression : kind === "flag" ? flag : TEXT.figures[figure];
  return text.trim().slice(0, 80);
}
