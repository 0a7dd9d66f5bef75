/**
 * Settings on trial: the device answers, and goes back unless a person keeps them. Shown on every page, above all else that is there.
 * Focus stands on "Go back now"; silence goes back, also when this page is gone: the server counts.
 */
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Store } from "../../data/store";
import type { Trial } from "../../wire/types";
import { type Model, modelOf, viewOnly } from "./model";
import { Restore } from "./restore";
import { server } from "./api";
import "./styles";
import { Message } from "../../ui/message";

const RADIUS = 20;
const UNDER_WAY = new Set<Trial["state"]>(["applying", "asking", "reverting"]);
const ROUND = 2 * Math.PI * RADIUS;
export default function Decks({ store }: { readonly store: Store }) {
  /** Devices whose last trial is over and was read. The next one is another. */
  const dismissed = useSignal<ReadonlySet<string>>(new Set());
  const all = [...store.control.value.values()].flatMap(({ trial }) => (trial ? [trial] : []));
  const underWay = all.filter(({ state }) => UNDER_WAY.has(state)).map(({ device }) => device).join();
  useEffect(() => {
    dismissed.value = new Set([...dismissed.peek()].filter((device) => !underWay.split(",").includes(device)));
  }, [underWay]);
  const trials = all.filter(({ device, state }) => UNDER_WAY.has(state) || !dismissed.value.has(device));
  const dismiss = (trial: Trial): void => {
    dismissed.value = new Set([...dismissed.value, trial.device]);
  };
  const box = useRef<HTMLDivElement>(null);
  // What lies under the panels stays in reach: the page ends above them.
  useEffect(() => {
    const observer = new ResizeObserver(() => document.documentElement.style.setProperty("--decks", `${box.current?.offsetHeight ?? 0}px`));
    if (box.current) observer.observe(box.current);
    return () => observer.disconnect();
  }, []);
  return (
    <div class="decks" ref={box}>
      {trials.map((trial) => (
        <Deck key={trial.device} trial={trial} model={modelOf(trial.device, store)} store={store} dismiss={() => dismiss(trial)} />
      ))}
    </div>
  );
}

interface Props {
  readonly trial: Trial;
  readonly model: Model;
  readonly store: Store;
  readonly dismiss: () => void;
}

/** Which device: several may be on trial at once. */
function Who({ model }: { readonly model: Model }) {
  const device = model.device.value;
  return (
    <span class="who">
      {device?.name ?? "A device"} {device?.serial_number && <span class="mono dim">{device.serial_number}</span>}
    </span>
  );
}

function Deck({ trial, model, store, dismiss }: Props) {
  if (trial.state === "asking") return <Asking trial={trial} model={model} store={store} />;
  if (trial.state === "unreachable") return <Unreachable trial={trial} model={model} dismiss={dismiss} />;
  const busy = trial.state === "applying" || trial.state === "reverting";
  const title = { applying: "Trying the new settings", reverting: "Going back", kept: "Kept", reverted: "The old settings are back" }[trial.state];
  return (
    <section class="deck" aria-label="Settings on trial" role="status">
      <div class="grow">
        <h3>
          <Who model={model} />: {title}
        </h3>
        <p><Message text={trial.words} /></p>
      </div>
      {!busy && (
        <button type="button" class="btn edge" onClick={dismiss}>
          OK
        </button>
      )}
    </section>
  );
}

function Asking({ trial, model, store }: Omit<Props, "dismiss">) {
  const offline = store.connection.value !== "open";
  const back = useRef<HTMLButtonElement>(null);
  const seconds = useRef<HTMLElement>(null);
  const words = useRef<HTMLElement>(null);
  const ring = useRef<SVGCircleElement>(null);
  useEffect(() => {
    back.current?.focus();
    const show = (): void => {
      const left = Math.max(0, (trial.deadline ?? 0) - store.serverNow());
      const text = store.connection.peek() === "open" ? String(Math.ceil(left)) : "—";
      if (seconds.current && seconds.current.textContent !== text) seconds.current.textContent = text;
      if (words.current && words.current.textContent !== `${text} s`) words.current.textContent = `${text} s`;
      ring.current?.setAttribute("stroke-dasharray", `${(ROUND * Math.min(1, left / trial.seconds)).toFixed(1)} ${ROUND.toFixed(1)}`);
    };
    show();
    const timer = setInterval(show, 100);
    return () => clearInterval(timer);
  }, [trial.deadline]);
  return (
    <section class="deck" role="alertdialog" aria-labelledby="deck-title" aria-describedby="deck-words">
      <div class="ring" aria-hidden="true">
        <svg viewBox="0 0 46 46" width="46" height="46">
          <circle cx="23" cy="23" r={RADIUS} fill="none" stroke="var(--bg-active)" stroke-width="3" />
          <circle ref={ring} cx="23" cy="23" r={RADIUS} fill="none" stroke="var(--yours)" stroke-width="3" stroke-linecap="round" transform="rotate(-90 23 23)" />
        </svg>
        <b ref={seconds} />
      </div>
      <div class="grow">
        <h3 id="deck-title">
          <Who model={model} />: Keep these settings? <span class="mid" ref={words} aria-hidden="true" />
        </h3>
        <p id="deck-words">
          {offline ? "The server is not reached: nothing can be decided here now. It goes back by itself unless somebody kept it." : <Message text={trial.words} />}{" "}
          <span class="dim">{trial.changes.join(" · ")}</span>
        </p>
      </div>
      <button type="button" class="btn edge" ref={back} disabled={viewOnly.value || offline} onClick={() => void model.run(server.revert(trial.device))}>
        Go back now
      </button>
      <button type="button" class="btn main" disabled={viewOnly.value || offline} onClick={() => void model.run(server.keep(trial.device))}>
        Keep settings
      </button>
    </section>
  );
}

function Unreachable({ trial, model, dismiss }: Omit<Props, "store">) {
  return (
    <section class="deck bad" aria-label="The device is unreachable">
      <div class="grow">
        <h3>
          <span class="dot bad" /> <Who model={model} />: Unreachable until power cycle
        </h3>
        <p>
          <Message text={trial.words} /> Its page has “Restore communication” at any time.
        </p>
        <Restore model={model} />
      </div>
      <button type="button" class="btn edge" onClick={dismiss}>
        Later
      </button>
    </section>
  );
}
