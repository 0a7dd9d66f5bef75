/** The alarms of the selected device: state, value and limit of each, acknowledged by name. */
import { type Signal, signal } from "@preact/signals";
import { Button } from "../../ui/controls/button";
import { clock } from "../../ui/format/format";
import { request, type HttpProblem } from "../../requests/http";
import { ProblemNote } from "../../requests/problem-note";
import type { Panel } from "../../ui/dom/dom";
import type { AlarmInfo, AlarmState } from "../../wire/routes";
import { alarmMark, type AlarmOnDevice, alarmsOf, conditionText, idleAlarms, valueText } from "./states";
import { type NoticeState, noticeState, switchNotices } from "./notices";
import type { Deps } from "../../page/context";
import { storedName, storeName } from "../../requests/person-name";
import { COMMON } from "../../texts/common";
import { renderedPanel } from "../../panels/panel-host";
import { alarmList, openAlarm } from "./list";
import { TEXT } from "./texts";
import "./alarms.css";

/** State of one panel: the alarm that is being acknowledged, and the last problem. */
interface PanelState {
  readonly acknowledging: Signal<string | undefined>;
  readonly problem: Signal<HttpProblem | undefined>;
  readonly notices: Signal<NoticeState>;
}

interface Props {
  readonly deps: Deps;
  readonly alarms: Signal<readonly AlarmInfo[]>;
  readonly state: PanelState;
}

function AlarmPanel({ deps, alarms, state }: Props) {
  const device = deps.viewState.device.value ?? "";
  const own = alarmsOf(alarms.value, device);
  const idle = idleAlarms(alarms.value);
  return (
    <>
      {own.length === 0 && <p class="foot-note dim">{TEXT.none}</p>}
      {own.length > 0 && (
        <ul class="alarm-list text-sm">
          {own.map((one) => (
            <Row key={one.alarm.id} one={one} deps={deps} alarms={alarms} state={state} />
          ))}
        </ul>
      )}
      {idle.length > 0 && (
        <>
          <p class="foot-note dim">{TEXT.elsewhere}</p>
          <ul class="alarm-list text-sm">
            {idle.map((alarm) => (
              <li key={alarm.id} class="alarm-row control-row">
                <span class="dim">{alarm.definition.name}</span>
                <span class="grow" />
                <EditButton alarm={alarm} deps={deps} />
              </li>
            ))}
          </ul>
        </>
      )}
      {state.problem.value && <ProblemNote problem={state.problem.value} />}
      <div class="alarm-foot control-row">
        <Button
          changes
          look="small edge alarm-add"
          icon="plus"
          words={TEXT.add}
          onClick={() => openAlarm(deps.open, {})}
        />
        {own.length > 0 && <Notices state={state.notices} />}
      </div>
    </>
  );
}

/** Whether the browser notifies, where it can; the browser asks the person on the first click. */
function Notices({ state }: { readonly state: Signal<NoticeState> }) {
  if (state.value === "none") return null;
  if (state.value === "blocked") return <p class="text-xs dim">{TEXT.noticesBlocked}</p>;
  return (
    <Button
      look="small edge"
      aria-pressed={state.value === "on"}
      title={TEXT.noticesHelp}
      onClick={() => void switchNotices().then((now) => (state.value = now))}
    >
      {state.value === "on" && <span aria-hidden="true">✓ </span>}
      {TEXT.notify}
    </Button>
  );
}

function EditButton({ alarm: { id, definition }, deps }: { readonly alarm: AlarmInfo; readonly deps: Deps }) {
  return (
    <Button
      look="small"
      words={TEXT.edit}
      aria-label={TEXT.editNamed(definition.name)}
      onClick={() => openAlarm(deps.open, { id, definition })}
    />
  );
}

function Row({ one, deps, alarms, state }: Props & { readonly one: AlarmOnDevice }) {
  const { alarm, state: now } = one;
  const { symbol, word, tone } = alarmMark(one);
  const isAsking = state.acknowledging.value === alarm.id;
  return (
    <li class="alarm-row control-row">
      <span class={tone === "" ? "alarm-state" : `tag ${tone}`}>
        <span aria-hidden="true">{symbol}</span> {word}
      </span>
      <b class="ellipsis" title={alarm.definition.name}>
        {alarm.definition.name}
      </b>
      {now.raised && now.acknowledged === null && !isAsking && (
        <Button
          changes
          look="small edge"
          words={TEXT.acknowledge}
          aria-label={TEXT.acknowledgeNamed(alarm.definition.name)}
          onClick={() => (state.acknowledging.value = alarm.id)}
        />
      )}
      <EditButton alarm={alarm} deps={deps} />
      <span class="alarm-facts flex-wrap mid text-xs">
        <span class="mono">{conditionText(alarm.definition)}</span>
        {factsOf(now).map((text) => (
          <span key={text}>{text}</span>
        ))}
      </span>
      {now.problem !== "" && <span class="alarm-facts flex-wrap mid text-xs">{now.problem}</span>}
      {isAsking && <Acknowledge one={one} alarms={alarms} state={state} />}
    </li>
  );
}

/** What is known of a state, in pieces of a line. */
export function factsOf(state: AlarmState): readonly string[] {
  const { unit, value, raised_value, worst, since, acknowledged, acknowledged_by } = state;
  return [
    state.status !== "missing" && valueText(value, unit) !== "" ? TEXT.value(valueText(value, unit)) : "",
    state.raised && raised_value !== null
      ? TEXT.raisedValue(valueText(raised_value, unit), valueText(worst, unit))
      : "",
    since === null ? "" : TEXT.since(clock(since)),
    acknowledged === null ? "" : TEXT.by(acknowledged_by, clock(acknowledged)),
  ].filter(Boolean);
}

function Acknowledge({ one, alarms, state }: Omit<Props, "deps"> & { readonly one: AlarmOnDevice }) {
  const send = async (event: SubmitEvent): Promise<void> => {
    event.preventDefault();
    const by = String(new FormData(event.currentTarget as HTMLFormElement).get("by") ?? "").trim();
    if (by === "") return;
    storeName(by);
    const { id } = one.alarm;
    const body = { by, device: one.state.device };
    const outcome = await request("POST /api/alarms/{alarm}/acknowledge", { path: { alarm: id }, body });
    state.problem.value = outcome.ok ? undefined : outcome.problem;
    if (!outcome.ok) return;
    state.acknowledging.value = undefined;
    alarms.value = alarms.peek().map((other) => (other.id === id ? outcome.value : other));
  };
  return (
    <form class="alarm-acknowledge control-row" onSubmit={(event) => void send(event)}>
      <input
        name="by"
        type="text"
        maxLength={60}
        required
        autocomplete="name"
        aria-label={TEXT.yourName}
        placeholder={TEXT.yourName}
        defaultValue={storedName()}
        ref={(input) => input?.focus()}
      />
      <Button changes type="submit" look="small edge" words={TEXT.acknowledge} />
      <Button look="small" words={COMMON.cancel} onClick={() => (state.acknowledging.value = undefined)} />
    </form>
  );
}

export function mountAlarms(host: HTMLElement, deps: Deps): Panel {
  const state: PanelState = {
    acknowledging: signal(undefined),
    problem: signal(undefined),
    notices: signal(noticeState()),
  };
  return renderedPanel(host, <AlarmPanel deps={deps} alarms={alarmList(deps.store)} state={state} />);
}
