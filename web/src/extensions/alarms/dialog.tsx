/** The form of an alarm: added or changed, with mistakes marked where they are. */
import { batch, type Signal, useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import { selected } from "../../panels/panel-context";
import type { Deps, App } from "../../page/context";
import { Button } from "../../ui/controls/button";
import { OptionList, Segmented } from "../../ui/controls/choices";
import { Dialog } from "../../ui/controls/dialog";
import { type HttpProblem, request } from "../../requests/http";
import { ProblemNote } from "../../requests/problem-note";
import { useAnswer } from "../../requests/use-answer";
import { fullName } from "../../wire/device-name";
import { protocolOf } from "../../wire/capabilities";
import type { AlarmCheck, DeviceFilter } from "../../wire/routes";
import type { ChannelInfo, DeviceInfo } from "../../wire/types";
import { ANY, definitionOf, fieldsOf, lastingName, alarmName, type AlarmFields, type HealthFigure } from "./fields";
import { PreviewNote, type PreviewPlace } from "./preview";
import { NumberField, RecordingChoice } from "./recording-choice";
import { COMMON } from "../../texts/common";
import { alarmList, draftOf } from "./list";
import { TEXT } from "./texts";

const CHECK_AFTER_MS = 300;
const KINDS = ["expression", "flag", "health"] as const;

interface Props {
  readonly app: App;
  readonly onClose: () => void;
  /** The open recording whose signal the alarm is on; absent: a live device. */
  readonly over?: RecordingPlace;
}

export interface RecordingPlace extends Omit<PreviewPlace, "device"> {
  readonly recording: string;
  readonly deps: Pick<Deps, "store" | "viewState">;
  readonly onSaved: () => void;
}

export function AlarmDialog({ app, onClose, over }: Props) {
  const draft = draftOf(app);
  const device = draft.device ?? (over ? selected(over.deps) : app.device.value);
  const fields = useSignal(fieldsOf(draft, device));
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const isRemoving = useSignal(false);
  /** The definition that is on its way, as JSON. */
  const sending = useRef("");
  const set = (change: Partial<AlarmFields>): void => {
    fields.value = { ...fields.peek(), ...change };
  };
  const definition = definitionOf(fields.value, draft.definition);
  const stamp = JSON.stringify(definition);
  const isEmpty = definition.condition.kind === "expression" && definition.condition.expression === "";
  const checked = useAnswer(
    isEmpty ? "" : stamp,
    (signal) => request("POST /api/alarms/check", { body: definition, signal }),
    { typedMs: CHECK_AFTER_MS },
  );
  // of what is in the form now: a mistake is marked at its place in the text
  const check = checked.isOld ? undefined : checked.answer;

  const done = (outcome: { readonly ok: true } | { readonly ok: false; readonly problem: HttpProblem }): void => {
    if (!outcome.ok) {
      problem.value = outcome.problem;
      return;
    }
    void request("GET /api/alarms").then((found) => {
      batch(() => {
        if (found.ok) alarmList(app.store).value = found.value;
        over?.onSaved();
        onClose();
      });
    });
  };
  const save = async (event: SubmitEvent): Promise<void> => {
    event.preventDefault();
    if (sending.current === stamp) return; // a double click adds it once
    sending.current = stamp;
    const body = definition;
    done(
      draft.id === undefined
        ? await request("POST /api/alarms", { body })
        : await request("PUT /api/alarms/{alarm}", { path: { alarm: draft.id }, body }),
    );
    sending.current = "";
  };
  const remove = async (): Promise<void> => {
    if (!isRemoving.value) isRemoving.value = true;
    else done(await request("DELETE /api/alarms/{alarm}", { path: { alarm: draft.id ?? "" } }));
  };
  const channels = (over?.deps.store ?? app.store).channels.value
    .map(({ info }) => info)
    .filter((info) => info.device === device?.id);
  return (
    <Dialog title={draft.id === undefined ? TEXT.newAlarm : TEXT.editAlarm} onClose={onClose}>
      <form class="alarm-form stacked" onSubmit={(event) => void save(event)}>
        <div class="alarm-field">
          <Segmented
            label={TEXT.kind}
            value={fields.value.kind}
            options={KINDS.map((kind) => [kind, TEXT.kinds[kind]])}
            onChoose={(kind) =>
              set({ kind, clear: "", ...(kind === "flag" && fields.value.flag === "" ? firstFlag(channels) : {}) })
            }
          />
        </div>
        <ConditionFields fields={fields} set={set} channels={channels} check={check} />
        <label>
          {TEXT.name}
          <input
            type="text"
            maxLength={80}
            value={fields.value.name}
            placeholder={alarmName(fields.value)}
            onInput={(event) => set({ name: event.currentTarget.value })}
          />
        </label>
        <div class="alarm-pair">
          <NumberField title={TEXT.raiseAfter} value={fields.value.raise} onValue={(raise) => set({ raise })} />
          <NumberField
            title={TEXT.clearAfter}
            value={fields.value.clearAfter}
            onValue={(clearAfter) => set({ clearAfter })}
          />
          <label>
            {TEXT.level}
            <OptionList
              value={fields.value.level}
              options={[
                ["warning", TEXT.levels.warning],
                ["error", TEXT.levels.error],
              ]}
              onChoose={(level) => set({ level })}
            />
          </label>
          <label>
            {TEXT.clears}
            <OptionList
              value={fields.value.latched ? "latched" : ""}
              options={[
                ["", TEXT.clearsByItself],
                ["latched", TEXT.latched],
              ]}
              onChoose={(latched) => set({ latched: latched !== "" })}
            />
          </label>
          {draft.id !== undefined && (
            <label>
              {TEXT.evaluation}
              <OptionList
                value={fields.value.enabled ? "on" : ""}
                options={[
                  ["on", TEXT.enabled],
                  ["", TEXT.disabled],
                ]}
                onChoose={(enabled) => set({ enabled: enabled !== "" })}
              />
            </label>
          )}
          <DeviceChoice fields={fields.value} set={set} device={device} stored={draft.definition?.devices} />
          <RecordingChoice fields={fields.value.recording} onFields={(recording) => set({ recording })} />
        </div>
        <label>
          {TEXT.webhook}
          <input
            type="text"
            inputMode="url"
            maxLength={2000}
            value={fields.value.webhook}
            spellcheck={false}
            autocapitalize="off"
            autocomplete="off"
            placeholder={TEXT.webhookExample}
            onInput={(event) => set({ webhook: event.currentTarget.value })}
          />
        </label>
        <PreviewNote
          stamp={check?.valid === true ? stamp : undefined}
          source={over?.recording ?? device?.id}
          recorded={over && device && { device: device.id, show: over.show }}
        />
        {[checked.problem, problem.value].map((one) => one && <ProblemNote key={one.message} problem={one} />)}
        <div class="control-row">
          <Button changes type="submit" look="main" words={TEXT.save} disabled={isEmpty || check?.valid === false} />
          <Button words={COMMON.cancel} onClick={onClose} />
          <span class="grow" />
          {draft.id !== undefined && (
            <Button changes words={isRemoving.value ? TEXT.confirmRemove : TEXT.remove} onClick={() => void remove()} />
          )}
        </div>
      </form>
    </Dialog>
  );
}

interface FieldProps {
  readonly fields: Signal<AlarmFields>;
  readonly set: (change: Partial<AlarmFields>) => void;
  readonly channels: readonly ChannelInfo[];
  readonly check: AlarmCheck | undefined;
}

function ConditionFields({ fields, set, channels, check }: FieldProps) {
  const { kind, expression, clear, figure, limit } = fields.value;
  if (kind === "flag") return <FlagFields fields={fields} set={set} channels={channels} check={check} />;
  if (kind === "health")
    return (
      <div class="alarm-pair">
        <label>
          {TEXT.figure}
          <OptionList
            value={figure}
            options={(Object.keys(TEXT.figures) as HealthFigure[]).map((name) => [name, TEXT.figures[name]])}
            onChoose={(name) => set({ figure: name })}
          />
        </label>
        {figure !== "link" && (
          <>
            <NumberField title={TEXT.limit} value={limit} onValue={(value) => set({ limit: value })} />
            <NumberField title={TEXT.clear} value={clear} onValue={(value) => set({ clear: value })} />
          </>
        )}
      </div>
    );
  const isWrong = check?.valid === false;
  return (
    <>
      <label>
        {TEXT.condition}
        <input
          type="text"
          class="mono"
          maxLength={400}
          value={expression}
          spellcheck={false}
          autocapitalize="off"
          aria-invalid={isWrong}
          aria-describedby="alarm-condition-note"
          onInput={(event) => set({ expression: event.currentTarget.value })}
        />
      </label>
      <div id="alarm-condition-note" class="alarm-note mid text-xs" role="status">
        {isWrong ? <Mistake text={expression} check={check} /> : check?.notes.join(" ") || TEXT.conditionHelp}
      </div>
      <label>
        {TEXT.clear}
        <input
          type="text"
          class="mono"
          maxLength={400}
          value={clear}
          spellcheck={false}
          title={TEXT.clearHelp}
          onInput={(event) => set({ clear: event.currentTarget.value })}
        />
      </label>
    </>
  );
}

/** The place in a message of the server, which the mark shows. */
const PLACE = / \(character \d+\)$/;

/** The expression with its mistake marked, and what is wrong. */
export function Mistake({ text, check }: { readonly text: string; readonly check: AlarmCheck }) {
  const { begin, end } = check;
  const from = begin === null ? -1 : begin + leadingSpaces(text);
  return (
    <>
      {from >= 0 && end !== null && (
        <p class="alarm-mistake mono">
          <span class="visually-hidden">{TEXT.mistakeHere} </span>
          {text.slice(0, from)}
          <mark>{text.slice(from, end + leadingSpaces(text)) || "␣"}</mark>
          {text.slice(end + leadingSpaces(text))}
        </p>
      )}
      <p>
        {check.message.replace(PLACE, "")} {check.hint}
      </p>
    </>
  );
}

const leadingSpaces = (text: string): number => text.length - text.trimStart().length;

/** The status words of a device, with the names of their flags. */
function statusWords(
  channels: readonly ChannelInfo[],
): readonly { readonly name: string; readonly flags: readonly string[] }[] {
  return channels
    .map(({ name, columns }) => ({ name, flags: columns.flatMap(({ bits }) => bits.map((one) => one.name)) }))
    .filter(({ flags }) => flags.length > 0);
}

/** The first flag of a device, before one is chosen. */
function firstFlag(channels: readonly ChannelInfo[]): Partial<AlarmFields> {
  const [first] = statusWords(channels);
  return first === undefined ? {} : { signal: first.name, flag: first.flags[0] ?? "" };
}

function FlagFields({ fields, set, channels }: FieldProps) {
  const words = statusWords(channels);
  const { signal, flag, isSet } = fields.value;
  const chosen = words.find(({ name }) => name === signal);
  if (words.length === 0 && signal === "") return <p class="foot-note dim">{TEXT.noFlags}</p>;
  const names = chosen === undefined ? [signal, ...words.map(({ name }) => name)] : words.map(({ name }) => name);
  const flags = chosen === undefined || !chosen.flags.includes(flag) ? [flag, ...(chosen?.flags ?? [])] : chosen.flags;
  return (
    <div class="alarm-pair">
      <label>
        {TEXT.status}
        <OptionList
          value={signal}
          options={names.map((name) => [name, name])}
          onChoose={(name) => set({ signal: name, flag: words.find((one) => one.name === name)?.flags[0] ?? "" })}
        />
      </label>
      <label>
        {TEXT.flag}
        <OptionList value={flag} options={flags.map((name) => [name, name])} onChoose={(name) => set({ flag: name })} />
      </label>
      <label>
        {TEXT.flagState}
        <OptionList
          value={isSet ? "set" : "clear"}
          options={[
            ["set", TEXT.flagSet],
            ["clear", TEXT.flagClear],
          ]}
          onChoose={(state) => set({ isSet: state === "set" })}
        />
      </label>
    </div>
  );
}

interface DeviceProps {
  readonly fields: AlarmFields;
  readonly set: (change: Partial<AlarmFields>) => void;
  readonly device: DeviceInfo | undefined;
  readonly stored: DeviceFilter | undefined;
}

function DeviceChoice({ fields, set, device, stored }: DeviceProps) {
  const short = device && (protocolOf(device.protocol)?.short ?? device.protocol);
  const choices: readonly (readonly [string, DeviceFilter])[] = [
    ...(device ? [[TEXT.thisDevice(fullName(device)), { ...ANY, device: lastingName(device) }] as const] : []),
    ...(device?.protocol ? [[TEXT.family(short ?? ""), { ...ANY, family: device.protocol }] as const] : []),
    [TEXT.allDevices, ANY],
  ];
  const same = (a: DeviceFilter, b: DeviceFilter): boolean => JSON.stringify(a) === JSON.stringify(b);
  const offered =
    stored && !choices.some(([, one]) => same(one, stored)) ? [[TEXT.asStored, stored] as const, ...choices] : choices;
  return (
    <label>
      {TEXT.devices}
      <OptionList
        value={offered.findIndex(([, one]) => same(one, fields.devices))}
        options={offered.map(([title], k) => [k, title])}
        onChoose={(k) => set({ devices: offered[k]?.[1] ?? ANY })}
      />
    </label>
  );
}
