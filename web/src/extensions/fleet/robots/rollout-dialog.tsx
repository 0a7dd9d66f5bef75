/** The profile of a group, applied to its robots: the plan, then how it goes. It goes on when the dialog is closed. */
import { type Signal, useSignal } from "@preact/signals";
import { Dialog } from "../../../ui/controls/dialog";
import { RolloutPlanForm } from "./rollout-plan";
import { TEXT } from "./rollout-texts";
import { Button } from "../../../ui/controls/button";
import { request } from "../../../requests/http";
import { Message } from "../../../ui/controls/message";
import { storedName } from "../../../requests/person-name";
import { Answered, useAnswer } from "../../../requests/use-answer";
import type { Rollout, RolloutDevice } from "../../../wire/routes";
import { PersonForm } from "./person-form";
import "./rollouts.css";
import "./settings.css";

interface Props {
  readonly robot: string;
  readonly group: string;
  readonly device: string;
  /** A rollout that exists; undefined for a plan. */
  readonly rollout: number | undefined;
  readonly onClose: () => void;
}

export function RolloutDialog({ robot, group, device, rollout, onClose }: Props) {
  const shown = useSignal(rollout);
  return (
    <Dialog title={TEXT.title(group)} onClose={onClose}>
      <div class="rollout-dialog stacked">
        {shown.value === undefined ? (
          <RolloutPlanForm
            robot={robot}
            device={device}
            follow={(id) => {
              shown.value = id;
            }}
          />
        ) : (
          <RolloutProgress id={shown.value} />
        )}
      </div>
    </Dialog>
  );
}

/** Pause between two requests, ms: of a rollout, and for each of its devices. */
const ASK_MS = 1000;
const ASK_DEVICE_MS = 2;
/** What a person looks for comes first. */
const ORDER: readonly RolloutDevice["state"][] = [
  ...(["failed", "unknown", "applying", "watching", "confirming"] as const),
  ...(["left", "done", "waiting", "not-started"] as const),
];
const BUSY: ReadonlySet<RolloutDevice["state"]> = new Set(["applying", "watching", "confirming"]);

function RolloutProgress({ id }: { readonly id: number }) {
  const isNaming = useSignal(false);
  const pauseMs = (newest: Rollout | undefined): number | undefined =>
    newest && newest.state !== "running" ? undefined : ASK_MS + ASK_DEVICE_MS * (newest?.devices.length ?? 0);
  const path = { rollout: id };
  const asked = useAnswer(`${id}`, () => request("GET /api/fleet/rollouts/{rollout}", { path }), { everyMs: pauseMs });
  const stop = async (by: string): Promise<void> => {
    isNaming.value = false;
    await asked.send(request("POST /api/fleet/rollouts/{rollout}/stop", { path, body: { by } }));
  };
  const askToStop = (): void => {
    const by = storedName();
    if (by === "") isNaming.value = true;
    else void stop(by);
  };
  return (
    <Answered of={asked}>
      {(found) => <Progress found={found} isNaming={isNaming} stop={stop} askToStop={askToStop} />}
    </Answered>
  );
}

interface ProgressProps {
  readonly found: Rollout;
  readonly isNaming: Signal<boolean>;
  readonly stop: (by: string) => Promise<void>;
  readonly askToStop: () => void;
}

function Progress({ found, isNaming, stop, askToStop }: ProgressProps) {
  const done = found.devices.filter(({ state }) => state === "done").length;
  const isRunning = found.state === "running";
  const devices = [...found.devices].sort((a, b) => ORDER.indexOf(a.state) - ORDER.indexOf(b.state));
  return (
    <>
      <p role="status">
        <b>{TEXT.states[found.state]}</b> <span class="dim">{TEXT.running(found.id, found.by)}</span>
        {found.words !== "" && (
          <>
            <br />
            <Message text={found.words} />
          </>
        )}
      </p>
      <progress max={found.devices.length} value={done} aria-label={TEXT.progress} />
      <p class="mid">
        {isRunning && `${TEXT.wave(found.wave, found.waves.length)} · `}
        {TEXT.doneOf(done, found.devices.length)}
      </p>
      {isRunning && !isNaming.value && (
        <div class="rollout-stop flex-row">
          {found.stopped_by === "" ? (
            <Button changes look="edge" words={TEXT.stop} title={TEXT.stopHint} onClick={askToStop} />
          ) : (
            <span class="mid">{TEXT.stopping}</span>
          )}
        </div>
      )}
      {isNaming.value && <PersonForm title={TEXT.stop} send={stop} cancel={() => (isNaming.value = false)} />}
      <ul class="rollout-devices">
        {devices.map((one) => (
          <Row key={`${one.robot} ${one.device}`} one={one} />
        ))}
      </ul>
    </>
  );
}

function Row({ one: { robot, name, state, words, wave } }: { readonly one: RolloutDevice }) {
  const tone = state === "failed" || state === "unknown" ? "bad" : state === "left" ? "warn" : "";
  return (
    <li>
      <span class={`dot ${tone || (BUSY.has(state) ? "live" : state === "done" ? "" : "off")}`} />
      <span>
        <b>{TEXT.deviceOf(robot, name)}</b>
        {words !== "" && state !== "done" && (
          <small class="dim">
            <Message text={words} />
          </small>
        )}
      </span>
      <span class="mid">{state === "waiting" ? TEXT.waitingFor(wave) : TEXT.deviceStates[state]}</span>
    </li>
  );
}
