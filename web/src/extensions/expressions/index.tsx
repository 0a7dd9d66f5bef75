/** Signals that are computed from others by an expression: made, edited and removed in the tree of signals. */
import { registerExtension, type Slots } from "../../extension/extension";
import type { LiveDialogProps, Deps } from "../../page/context";
import { added } from "../../signals/custom-plots";
import { isComputed } from "../../signals/names";
import { Button } from "../../ui/controls/button";
import { request } from "../../requests/http";
import { late } from "../../ui/dom/late";
import type { ComputedSignal } from "../../wire/routes";
import type { ChannelInfo } from "../../wire/types";
import { TEXT } from "./texts";

const NewSignal = late(async () => (await import("./new-signal")).NewSignal);

type OnSaid = Slots["signalsHead"]["onSaid"];

/** What the form is about. */
interface Subject {
  /** The signal that is edited; undefined: a new one. */
  readonly signal: ComputedSignal | undefined;
  readonly onSaid: OnSaid;
}

function open(deps: Deps, signal: ComputedSignal | undefined, onSaid: OnSaid): void {
  const subject: Subject = { signal, onSaid };
  deps.open.dialog("expressions/dialog", subject);
}

function Live({ app, onClose }: LiveDialogProps) {
  const { signal, onSaid } = app.subject.value as Subject;
  const made = (name: string, columns: readonly string[]): void => {
    onSaid(signal ? TEXT.edited(name) : TEXT.made(name));
    if (signal) return;
    const { customPlots, view } = app.viewState;
    const device = view.peek().device ?? "";
    const signals = columns.map((column) => ({ device, channel: name, column }));
    customPlots.value = added(customPlots.peek(), { kind: "new" }, signals);
  };
  return <NewSignal deps={app} signal={signal} onClose={onClose} onMade={made} />;
}

function NewSignalButton({ deps, isLive, onSaid }: Slots["signalsHead"]) {
  if (!isLive) return null;
  return (
    <Button changes look="edge" icon="plus" words={TEXT.newSignal} onClick={() => open(deps, undefined, onSaid)} />
  );
}

/** What can be done with a computed signal. */
function ComputedActions({ deps, row, isLive, onSaid }: Slots["signalActions"]) {
  const info = row.channel?.info;
  return isLive && info && isComputed(info) ? <Actions deps={deps} channel={info} onSaid={onSaid} /> : null;
}

interface ActionsProps {
  readonly deps: Deps;
  readonly channel: ChannelInfo;
  readonly onSaid: OnSaid;
}

function Actions({ deps, channel: { device, name }, onSaid }: ActionsProps) {
  const edit = async (): Promise<void> => {
    const outcome = await request("GET /api/devices/{device}/signals", { path: { device } });
    const found = outcome.ok ? outcome.value.find((one) => one.name === name) : undefined;
    if (found) open(deps, found, onSaid);
    else if (!outcome.ok) onSaid(outcome.problem.message);
  };
  const remove = async (): Promise<void> => {
    const outcome = await request("DELETE /api/devices/{device}/signals/{name}", { path: { device, name } });
    onSaid(outcome.ok ? TEXT.gone(name) : outcome.problem.message);
    if (outcome.ok) deps.store.forgetChannel(device, name);
  };
  return (
    <>
      <span />
      <Button changes look="edge" words={TEXT.edit} onClick={() => void edit()} />
      <Button changes look="edge" icon="trash" words={TEXT.remove} onClick={() => void remove()} />
    </>
  );
}

registerExtension({
  name: "expressions",
  views: [
    { slot: "signalsHead", order: 10, View: NewSignalButton },
    { slot: "signalActions", order: 20, View: ComputedActions },
  ],
  dialogs: [{ overlay: "expressions/dialog", Live }],
});
