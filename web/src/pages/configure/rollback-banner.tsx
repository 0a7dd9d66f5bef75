/**
 * Temporary settings: the device answers, and is rolled back unless the change is confirmed. Shown on top of every page.
 * Without an answer it rolls back, even if this page is gone: the server counts. Only the page that wrote moves its focus here, to the
 * banner itself: a key that was meant for something else must not answer for the person who wrote.
 */
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Store } from "../../data/store";
import { fullName } from "../../wire/device-name";
import type { PendingRollback } from "../../wire/types";
import type { App } from "../../page/context";
import { type Model, modelOf } from "./model";
import { configureOf } from "./view-state";
import { Restore } from "./restore";
import { configureApi } from "./api";
import "./styles";
import { Button } from "../../ui/controls/button";
import type { Outcome } from "../../requests/http";
import { Message } from "../../ui/controls/message";
import { ProblemNote } from "../../requests/problem-note";
import { TEXT } from "../../texts/configure";

const RADIUS = 20;
const UNDER_WAY = new Set<PendingRollback["state"]>(["applying", "pending", "rolling-back"]);
const ROUND = 2 * Math.PI * RADIUS;
export function Decks({ app }: { readonly app: App }) {
  const { store } = app;
  /** Devices whose last rollback is over and was acknowledged. */
  const dismissed = useSignal<ReadonlySet<string>>(new Set());
  const all = [...store.jobs.value.values()].flatMap((jobs) => (jobs.pending_rollback ? [jobs.pending_rollback] : []));
  const underWay = all
    .filter(({ state }) => UNDER_WAY.has(state))
    .map(({ device }) => device)
    .join();
  useEffect(() => {
    dismissed.value = new Set([...dismissed.peek()].filter((device) => !underWay.split(",").includes(device)));
  }, [underWay]);
  const { written } = configureOf(app);
  const isNews = ({ device, state }: PendingRollback): boolean =>
    UNDER_WAY.has(state) || ((state === "unreachable" || written.value.has(device)) && !dismissed.value.has(device));
  const rollbacks = all.filter(isNews);
  const dismiss = (rollback: PendingRollback): void => {
    dismissed.value = new Set([...dismissed.value, rollback.device]);
  };
  const box = useRef<HTMLDivElement>(null);
  // What lies under the panels stays in reach: the page ends above them.
  useEffect(() => {
    const observer = new ResizeObserver(() =>
      document.documentElement.style.setProperty("--decks", `${box.current?.offsetHeight ?? 0}px`),
    );
    if (box.current) observer.observe(box.current);
    return () => observer.disconnect();
  }, []);
  return (
    <div class="pending-rollbacks" ref={box}>
      {rollbacks.map((rollback) => (
        <Deck
          key={rollback.device}
          rollback={rollback}
          model={modelOf(rollback.device, app)}
          store={store}
          dismiss={() => dismiss(rollback)}
        />
      ))}
    </div>
  );
}

interface Props {
  readonly rollback: PendingRollback;
  readonly model: Model;
  readonly store: Store;
  readonly dismiss: () => void;
}

/** Which device: several may have a rollback pending at once. */
function Who({ model }: { readonly model: Model }) {
  const device = model.device.value;
  return <span class="who">{device ? fullName(device) : TEXT.aDevice}</span>;
}

function Deck({ rollback, model, store, dismiss }: Props) {
  if (rollback.state === "pending") return <Asking rollback={rollback} model={model} store={store} />;
  if (rollback.state === "unreachable") return <Unreachable rollback={rollback} model={model} dismiss={dismiss} />;
  const busy = rollback.state === "applying" || rollback.state === "rolling-back";
  const title = {
    applying: TEXT.applyingTheNewSettings,
    "rolling-back": TEXT.rollingBack,
    confirmed: TEXT.confirmed,
    "rolled-back": TEXT.rolledBack,
  }[rollback.state];
  return (
    <section class="pending-rollback" aria-label={TEXT.temporarySettings} role="status">
      <div class="grow">
        <h3>
          <Who model={model} />: {title}
        </h3>
        <p>
          <Message text={rollback.words} />
        </p>
      </div>
      {!busy && <Button look="edge" words={TEXT.ok} onClick={dismiss} />}
    </section>
  );
}

/** A press that soon was begun before the banner stood under it. */
const SETTLE_MS = 600;

function Asking({ rollback, model, store }: Omit<Props, "dismiss">) {
  const offline = store.connection.value !== "open";
  const isOwn = model.page.written.value.has(rollback.device);
  const banner = useRef<HTMLElement>(null);
  const shown = useRef(performance.now());
  const seconds = useRef<HTMLElement>(null);
  const words = useRef<HTMLElement>(null);
  const ring = useRef<SVGCircleElement>(null);
  // biome-ignore lint/correctness/useExhaustiveDependencies: one countdown for each trial that is listed
  useEffect(() => {
    if (isOwn && !isInUse(document.activeElement)) banner.current?.focus();
    const show = (): void => {
      const left = Math.max(0, (rollback.deadline ?? 0) - store.serverNow());
      const text = store.connection.peek() === "open" ? String(Math.ceil(left)) : "—";
      if (seconds.current && seconds.current.textContent !== text) seconds.current.textContent = text;
      if (words.current && words.current.textContent !== `${text} s`) words.current.textContent = `${text} s`;
      ring.current?.setAttribute(
        "stroke-dasharray",
        `${(ROUND * Math.min(1, left / rollback.seconds)).toFixed(1)} ${ROUND.toFixed(1)}`,
      );
    };
    show();
    const timer = setInterval(show, 100);
    return () => clearInterval(timer);
  }, [rollback.deadline]);
  const answer = (send: (device: string) => Promise<Outcome<unknown>>): void => {
    if (performance.now() - shown.current < SETTLE_MS) return;
    model.page.wrote(rollback.device);
    void model.run(send(rollback.device));
  };
  return (
    <section
      class="pending-rollback"
      role={isOwn ? "alertdialog" : "region"}
      aria-labelledby="deck-title"
      aria-describedby="deck-words"
      tabIndex={-1}
      ref={banner}
    >
      <div class="ring" aria-hidden="true">
        <svg viewBox="0 0 46 46" width="46" height="46">
          <circle cx="23" cy="23" r={RADIUS} fill="none" stroke="var(--bg-active)" stroke-width="3" />
          <circle
            ref={ring}
            cx="23"
            cy="23"
            r={RADIUS}
            fill="none"
            stroke="var(--yours)"
            stroke-width="3"
            stroke-linecap="round"
            transform="rotate(-90 23 23)"
          />
        </svg>
        <b ref={seconds} />
      </div>
      <div class="grow">
        <h3 id="deck-title">
          <Who model={model} />
          {TEXT.confirmNewSettings} <span class="mid" ref={words} aria-hidden="true" />
        </h3>
        <p id="deck-words">
          {offline ? TEXT.confirmUnavailable : <Message text={rollback.words} />}{" "}
          <span class="dim">{rollback.changes.join(" · ")}</span>
        </p>
        {model.problem.value && <ProblemNote problem={model.problem.value} />}
      </div>
      <Button
        changes
        look="edge"
        words={TEXT.rollBackNow}
        disabled={offline}
        onClick={() => answer(configureApi.rollBack)}
      />
      <Button
        changes
        look="main"
        words={TEXT.confirm}
        disabled={offline}
        onClick={() => answer(configureApi.confirm)}
      />
    </section>
  );
}

/** Whether someone works with the focused element: it is not the bar or the question that the change was written with. */
const isInUse = (focused: Element | null): boolean =>
  focused !== null && focused !== document.body && focused.closest(".apply-bar, dialog") === null;

function Unreachable({ rollback, model, dismiss }: Omit<Props, "store">) {
  return (
    <section class="pending-rollback bad" aria-label={TEXT.unreachableLabel}>
      <div class="grow">
        <h3>
          <span class="dot bad" /> <Who model={model} />
          {TEXT.unreachableUntilPowerCycle}
        </h3>
        <p>
          <Message text={rollback.words} /> {TEXT.restoreHint}
        </p>
        <Restore model={model} />
        {model.problem.value && <ProblemNote problem={model.problem.value} />}
      </div>
      <Button look="edge" words={TEXT.later} onClick={dismiss} />
    </section>
  );
}
