/**
 * Settings on trial: the device answers, and goes back unless a person keeps them. Shown on every page, above all else that is there.
 * Focus stands on "Go back now"; silence goes back, also when this page is gone: the server counts.
 */
import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Store } from "../../data/store";
import type { Trial } from "../../wire/types";
import { type Model, modelOf, viewOnly } from "./model";
import { Restore } from "./restore";
import { server } from "./server";
import "./styles";

const RADIUS = 20;
const ROUND = 2 * Math.PI * RADIUS;
/** Trials whose end was read, by what they said. */
const dismissed = signal<ReadonlySet<string>>(new Set());
const keyOf = (trial: Trial): string => `${trial.device} ${trial.state} ${trial.changes.join()} ${trial.words}`;
const dismiss = (trial: Trial): void => {
  dismissed.value = new Set([...dismissed.value, keyOf(trial)]);
};

export default function Decks({ store }: { readonly store: Store }) {
  const trials = [...store.control.value.values()].flatMap(({ trial }) => (trial && !dismissed.value.has(keyOf(trial)) ? [trial] : []));
  return (
    <div class="decks">
      {trials.map((trial) => (
        <Deck key={trial.device} trial={trial} model={modelOf(trial.device, store)} store={store} />
      ))}
    </div>
  );
}

interface Props {
  readonly trial: Trial;
  readonly model: Model;
  readonly store: Store;
}

function Deck({ trial, model, store }: Props) {
  if (trial.state === "asking") return <Asking trial={trial} model={model} store={store} />;
  if (trial.state === "unreachable") return <Unreachable trial={trial} model={model} />;
  const busy = trial.state === "applying" || trial.state === "reverting";
  const title = { applying: "Trying the new settings", reverting: "Going back", kept: "Kept", reverted: "The old settings are back" }[trial.state];
  return (
    <section class="deck" aria-label="Settings on trial" role="status">
      <div class="grow">
        <h3>{title}</h3>
        <p>{trial.words}</p>
      </div>
      {!busy && (
        <button type="button" class="btn edge" onClick={() => dismiss(trial)}>
          Good
        </button>
      )}
    </section>
  );
}

function Asking({ trial, model, store }: Props) {
  const back = useRef<HTMLButtonElement>(null);
  const seconds = useRef<HTMLElement>(null);
  const words = useRef<HTMLElement>(null);
  const ring = useRef<SVGCircleElement>(null);
  useEffect(() => {
    back.current?.focus();
    const show = (): void => {
      const left = Math.max(0, (trial.deadline ?? 0) - store.serverNow());
      const text = String(Math.ceil(left));
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
          Keep these settings? <span class="mid" ref={words} aria-hidden="true" />
        </h3>
        <p id="deck-words">
          {trial.words} <span class="dim">{trial.changes.join(" · ")}</span>
        </p>
      </div>
      <button type="button" class="btn edge" ref={back} disabled={viewOnly.value} onClick={() => void model.run(server.revert(trial.device))}>
        Go back now
      </button>
      <button type="button" class="btn main" disabled={viewOnly.value} onClick={() => void model.run(server.keep(trial.device))}>
        Keep settings
      </button>
    </section>
  );
}

function Unreachable({ trial, model }: Omit<Props, "store">) {
  return (
    <section class="deck bad" aria-label="The device is unreachable">
      <div class="grow">
        <h3>
          <span class="dot bad" /> Unreachable until power cycle
        </h3>
        <p>{trial.words}</p>
        <Restore model={model} />
      </div>
      <button type="button" class="btn edge" onClick={() => dismiss(trial)}>
        Later
      </button>
    </section>
  );
}
