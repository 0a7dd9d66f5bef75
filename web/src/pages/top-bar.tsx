/** The top bar: navigation and the time controls. On a phone the same controls are in the dock at the bottom. */
import { useRef, useLayoutEffect } from "preact/hooks";
import { Slot } from "../extension/extension";
import type { ViewActions } from "../data/view-actions";
import { recently } from "../panels/panel-context";
import type { Deps, App } from "../page/context";
import { Button } from "../ui/controls/button";
import { Select } from "../ui/controls/choices";
import { age, number, rate, span } from "../ui/format/format";
import { IconButton } from "../ui/controls/icon-button";
import { Icon, type IconName, Logo } from "../ui/controls/icons";
import { SPANS, ZOOM_STEP } from "../page/keys";
import { markOf, showsPlots } from "../page/page-state";
import { theme, toggleTheme } from "../ui/dom/theme";
import { ViewerButton } from "../views/viewers";
import { ArrangeButton } from "../workspace/arrange";
import { Record } from "./record-button";
import { href, isRemote, type PageName, pagesOf, route } from "../page/route";
import { Share } from "./share";
import { distinctName } from "../wire/device-name";
import type { DeviceInfo } from "../wire/types";
import { SimulatedTag } from "../ui/controls/simulated-tag";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/live";
import type { RefObject } from "preact";

/** Classes of buttons: what they do to a bar that is full (ui/layout.css, ui/phone.css). */
export const BAR_CLASS = {
  /** Takes the place of the name of the page on a phone. */
  overPlots: "over-plots",
  /** The first to be left out. */
  spareFirst: "spare-first",
  /** Left out while something is recorded, and on a phone. */
  spare: "desk spare",
} as const;

declare module "../extension/extension" {
  interface Slots {
    /** Buttons over plots: those of Live, or of an open recording. */
    readonly barViews: { readonly app: App; readonly deps: Deps; readonly isLive: boolean };
    /** Buttons over the plots of Live, before "Share". */
    readonly barShare: { readonly app: App };
  }
}

const PANELS: Readonly<Record<PageName, { readonly rail: string; readonly side: string }>> = {
  live: { rail: COMMON.devices, side: TEXT.valuesAndHealth },
  configure: { rail: COMMON.settings, side: COMMON.trafficLog },
  recordings: { rail: TEXT.filtersAndMarkers, side: TEXT.details },
};

interface Props {
  readonly app: App;
}

const STEPS_OF_FULL_BAR = 10; // ui/layout.css
/** More than a step makes: the bar takes back what it gave. */
const MUCH_ROOM_PX = 200;

/** @param deps of the panels that can be arranged: those of Live by default */
export function TopBar({ app, deps }: Props & { readonly deps?: Deps }) {
  const { page } = route.value;
  const isLive = page === "live";
  const panels = PANELS[page];
  const bar = useRef<HTMLElement>(null);
  useFit(bar, STEPS_OF_FULL_BAR);
  return (
    <header class="bar flex-row" ref={bar}>
      <div class="brand flex-row">
        <Logo />
        <span>imuscope</span>
        <small class="desk ellipsis">{location.hostname}</small>
      </div>
      <nav class="nav" aria-label={TEXT.pages}>
        {pagesOf(app).map(({ name, title }) => (
          <a key={name} href={href(name)} {...(route.value.page === name ? { "aria-current": "page" as const } : {})}>
            {title}
          </a>
        ))}
      </nav>
      {panels && <Toggle app={app} name="rail" label={panels.rail} icon="list" />}
      <span class="grow" />
      {isLive && showsPlots(app.state.value) && <TimeControls app={app} />}
      {page === "configure" && <StateTags app={app} />}
      <span class="grow desk" />
      {((isLive && showsPlots(app.state.value)) || route.value.recording !== undefined) && (
        <>
          <ViewerButton app={app} isLive={isLive} />
          <Slot name="barViews" with={{ app, deps: deps ?? app, isLive }} />
        </>
      )}
      {isLive && showsPlots(app.state.value) ? (
        <ArrangeButton app={app} deps={app} />
      ) : (
        deps && <ArrangeButton app={app} deps={deps} />
      )}
      <SimulatedTag of={deviceOf(deps ?? (isLive || page === "configure" ? app : undefined))} />
      {!isRemote(page) && <Record app={app} />}
      {isLive && showsPlots(app.state.value) && <Slot name="barShare" with={{ app }} />}
      {isLive && showsPlots(app.state.value) && <Share app={app} />}
      <IconButton
        icon="help"
        label={TEXT.helpLabel}
        word={TEXT.help}
        class="desk"
        title={TEXT.keys}
        onClick={() => (app.overlay.value = "help")}
      />
      <Theme />
      {panels && <Toggle app={app} name="side" label={panels.side} icon="side" />}
      {isLive && app.folded.value && (
        <IconButton
          icon="side"
          label={TEXT.showValuesAndHealth}
          class="desk only-wide"
          onClick={() => (app.folded.value = false)}
        />
      )}
      {(isLive || page === "configure") && <DeviceName app={app} />}
    </header>
  );
}

const deviceOf = (deps: Deps | undefined): DeviceInfo | undefined =>
  deps?.store.devices.value.find(({ id }) => id === deps.viewState.device.value);

/** State of the device and pending confirmation, if there is no room for the time controls. */
function StateTags({ app }: Props) {
  const device = app.device.value;
  const jobs = device && app.store.jobs.value.get(device.id);
  const health = device && app.store.health.value.get(device.id);
  if (!device) return null;
  const state = jobs?.state || markOf(device.status, 0).word;
  const streams = device.status === "live" && health;
  const rollback = jobs?.pending_rollback?.state === "pending" ? jobs.pending_rollback : undefined;
  return (
    <>
      <span class="tag desk state-tag">
        <span class={`dot ${markOf(device.status, 0).dot}`} />
        {state}
        {streams ? TEXT.samplesPerSecond(rate(health.rate)) : ""}
      </span>
      {rollback && <span class="tag yours desk state-tag">{TEXT.changesToConfirm(rollback.changes.length)}</span>}
    </>
  );
}

/** The time controls; absent while there is no time range. */
function TimeControls({ app }: Props) {
  const { isLive, actions } = app.viewState;
  // highlighted if live: not without a server connection, nor with a lost device
  const behind = app.store.behind(app.device.value?.id ?? "").total;
  const lit = isLive.value && !app.store.isCut && app.device.value?.status === "live" && behind === 0;
  return (
    <>
      <div class="segmented desk" role="group" aria-label={TEXT.playState}>
        <button type="button" aria-pressed={isLive.value} title={TEXT.followNewest} onClick={() => actions.live()}>
          <span class={lit ? "dot live" : "dot off"} />
          {behind === 0 ? TEXT.live : TEXT.liveBehind(age(behind).value, age(behind).unit)}
        </button>
        <button type="button" aria-pressed={!isLive.value} title={TEXT.pauseView} onClick={() => actions.pause()}>
          <Icon name="pause" />
          {COMMON.pause}
        </button>
      </div>
      <Window app={app} class="desk" words />
      <TimeBase app={app} />
      <Move app={app} />
    </>
  );
}

function Theme() {
  const other = theme.value === "dark" ? "light" : "dark";
  return (
    <IconButton
      icon={theme.value === "dark" ? "sun" : "moon"}
      label={TEXT.useTheme(TEXT.theme[other])}
      word={TEXT.themeWord[other]}
      onClick={toggleTheme}
    />
  );
}

interface ToggleProps extends Props {
  readonly name: "rail" | "side";
  readonly label: string;
  readonly icon: IconName;
}

/** Opens a panel that is folded because the window is narrow. */
function Toggle({ app: { sheet }, name, label, icon }: ToggleProps) {
  const open = sheet.value === name;
  return (
    <IconButton
      class={`desk ${name === "rail" ? "only-narrow" : "only-mid"}`}
      icon={icon}
      label={label}
      aria-expanded={open}
      aria-controls={name}
      onClick={() => (sheet.value = open ? undefined : name)}
    />
  );
}

/** On a phone the devices are behind the name of the selected one. */
function DeviceName({ app }: Props) {
  const { sheet } = app;
  const device = app.device.value;
  const mark = device ? markOf(device.status, recently(app, device.id).gaps) : { dot: "off", word: "none" };
  const open = sheet.value === "rail";
  return (
    <Button
      look="phone device-name"
      aria-expanded={open}
      aria-controls="rail"
      onClick={() => (sheet.value = open ? undefined : "rail")}
    >
      <span class={`dot ${mark.dot}`} />
      <span class="visually-hidden">{mark.word}: </span>
      <span class="ellipsis">{device ? distinctName(device, app.store.devices.value) : COMMON.devices}</span>
      <Icon name="down" />
    </Button>
  );
}

interface WindowProps extends Props {
  readonly class: string;
  readonly words?: boolean;
}

/** The length of the window; a length set by zooming is added to the list. */
function Window({ app, class: name, words = false }: WindowProps) {
  const { span: length, actions } = app.viewState;
  const current = length.value;
  const listed = SPANS.some((seconds) => Math.abs(seconds - current) < 1e-6);
  const all = listed ? SPANS : [...SPANS, current].sort((a, b) => a - b);
  return (
    <Select
      class={name}
      title={TEXT.windowLengthHint}
      words={words ? TEXT.window : undefined}
      label={TEXT.windowLength}
      value={current}
      options={all.map((seconds) => [seconds, `${span(seconds).value} ${span(seconds).unit}`])}
      onChoose={(seconds) => actions.setSpan(seconds)}
    />
  );
}

function TimeBase({ app }: Props) {
  const { timeBase, actions } = app.viewState;
  const device = timeBase.value === "device";
  const choose = (wanted: boolean) => () => {
    if (wanted !== device) actions.toggleTimeBase();
  };
  return (
    <div class="segmented desk time-axis-choice" role="group" aria-label={COMMON.timeAxis}>
      <button type="button" aria-pressed={device} title={TEXT.deviceTimeHint} onClick={choose(true)}>
        {COMMON.deviceTime}
      </button>
      <button type="button" aria-pressed={!device} title={TEXT.arrivalTimeHint} onClick={choose(false)}>
        {COMMON.arrivalTime}
      </button>
    </div>
  );
}

interface Step {
  readonly icon: IconName;
  readonly label: string;
  readonly extra: boolean;
  readonly act: (actions: ViewActions) => void;
}

const zoomed = number(ZOOM_STEP, 1);
const STEPS: readonly Step[] = [
  { icon: "first", label: TEXT.toMemoryStart, extra: true, act: (actions) => actions.toStart() },
  { icon: "back", label: TEXT.backTenth, extra: false, act: (actions) => actions.pan(-0.1) },
  { icon: "stepBack", label: COMMON.backOneSample, extra: true, act: (actions) => actions.stepSample(-1) },
  { icon: "stepForward", label: COMMON.forwardOneSample, extra: true, act: (actions) => actions.stepSample(1) },
  { icon: "forward", label: TEXT.forwardTenth, extra: false, act: (actions) => actions.pan(0.1) },
  { icon: "last", label: TEXT.toNow, extra: true, act: (actions) => actions.live() },
  { icon: "minus", label: COMMON.zoomOut(zoomed), extra: true, act: (actions) => actions.zoom(ZOOM_STEP) },
  { icon: "plus", label: COMMON.zoomIn(zoomed), extra: true, act: (actions) => actions.zoom(1 / ZOOM_STEP) },
  { icon: "fit", label: TEXT.fitMemory, extra: false, act: (actions) => actions.fit() },
];

/** Buttons for moving through time; each has a key as well. */
function Move({ app }: Props) {
  return (
    <div class="time-controls desk" role="group" aria-label={TEXT.timeNavigation}>
      {STEPS.map((step) => (
        <IconButton
          key={step.icon}
          class={step.extra ? "extra" : ""}
          icon={step.icon}
          label={step.label}
          onClick={() => step.act(app.viewState.actions)}
        />
      ))}
    </div>
  );
}

/** The controls of time for a thumb. */
export function Dock({ app }: Props) {
  const { isLive, timeBase, actions } = app.viewState;
  const live = isLive.value;
  return (
    <div class="dock" role="region" aria-label={TEXT.timeControls}>
      <Button
        look="edge icon"
        icon={live ? "pause" : "play"}
        aria-label={live ? COMMON.pause : TEXT.live}
        onClick={() => (live ? actions.pause() : actions.live())}
      />
      <Window app={app} class="" />
      <Button
        look="edge"
        words={timeBase.value === "device" ? COMMON.device : TEXT.arrival}
        aria-label={TEXT.timeAxisChoice}
        onClick={() => actions.toggleTimeBase()}
      />
      {STEPS.filter((step) => !step.extra).map((step) => (
        <Button
          key={step.icon}
          look="edge icon"
          icon={step.icon}
          aria-label={step.label}
          onClick={() => step.act(app.viewState.actions)}
        />
      ))}
    </div>
  );
}

/*
 * A row that gives way when it is full: step by step, until what remains has room.
 *
 * The steps done are in `data-full`, "1 2 3" after three; what a step hides is written in a style sheet, as
 * `[data-full~="3"] .words`. Measured, not derived from the width of the window: what stands in the row changes with
 * the page, the device, and whether it records.
 */

/** @param steps how many there are in the style sheet */
function useFit(row: RefObject<HTMLElement | null>, steps: number): void {
  useLayoutEffect(() => {
    const element = row.current;
    if (!element) return undefined;
    const isFull = (): boolean => element.scrollWidth > element.clientWidth;
    let done = 0;
    const give = (wanted: number): void => {
      done = wanted;
      element.dataset.full = Array.from({ length: wanted }, (_, i) => i + 1).join(" ");
    };
    const giveWay = (): void => {
      while (done < steps && isFull()) give(done + 1);
    };
    const fit = (): void => {
      give(0);
      giveWay();
    };
    // changed words may need more room, or leave much of it
    const spare = (): number =>
      [...element.querySelectorAll<HTMLElement>(":scope > .grow")].reduce(
        (sum, { offsetWidth }) => sum + offsetWidth,
        0,
      );
    const changed = new MutationObserver((changes) =>
      changes.some(({ type }) => type === "childList") || (done > 0 && spare() > MUCH_ROOM_PX) ? fit() : giveWay(),
    );
    const resized = new ResizeObserver(fit);
    changed.observe(element, { childList: true, characterData: true, subtree: true });
    resized.observe(element);
    void document.fonts?.ready.then(fit);
    return () => {
      changed.disconnect();
      resized.disconnect();
    };
  }, [row, steps]);
}
