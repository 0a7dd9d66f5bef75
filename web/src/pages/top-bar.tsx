/** The top bar: where we are, and the controls of time. On a phone the same controls stand in the dock at the bottom. */
import * as actions from "../data/view-actions";
import { view } from "../data/view-state";
import { recently } from "../panels/panel-context";
import { count, number, rate, span } from "../ui/format";
import { Icon, type IconName, Logo } from "../ui/icons";
import { SPANS, ZOOM_STEP } from "../ui/keys";
import { markOf, showsPlots } from "../ui/page-state";
import { theme, toggleTheme } from "../ui/theme";
import { SceneButton } from "../views/viser";
import { type App, folded, overlay, sheet } from "./app-state";
import { Record } from "./record-button";
import { href, PAGES, route } from "./route";
import { Share } from "./share";

/** What the folded panels of each page are called. */
const PANELS = {
  live: { rail: "Devices", side: "Values and health" },
  configure: { rail: "Settings", side: "Exchange" },
  recordings: { rail: "Filters and markers", side: "Details" },
} as const;

export function Bar({ app }: { readonly app: App }) {
  const { page } = route.value;
  const isLive = page === "live";
  return (
    <header class="bar">
      <div class="brand">
        <Logo />
        <span>imuscope</span>
        <small class="desk">{location.hostname}</small>
      </div>
      <nav class="nav" aria-label="Pages">
        {PAGES.map(({ name, title }) => (
          <a key={name} href={href(name)} {...(route.value.page === name ? { "aria-current": "page" as const } : {})}>
            {title}
          </a>
        ))}
      </nav>
      <Toggle name="rail" label={PANELS[page].rail} icon="list" />
      <span class="grow" />
      {isLive && showsPlots(app.state.value) && <TimeControls app={app} />}
      {page === "configure" && <StateTags app={app} />}
      <span class="grow desk" />
      {((isLive && showsPlots(app.state.value)) || route.value.recording !== undefined) && <SceneButton />}
      <Record app={app} />
      {isLive && showsPlots(app.state.value) && <Share />}
      <button type="button" class="btn icon desk" aria-label="Keys" title="Keys (?)" onClick={() => (overlay.value = "help")}>
        <Icon name="help" />
      </button>
      <Theme />
      <Toggle name="side" label={PANELS[page].side} icon="side" />
      {isLive && folded.value && (
        <button type="button" class="btn icon desk only-wide" aria-label="Show values and health" title="Show values and health" onClick={() => (folded.value = false)}>
          <Icon name="side" />
        </button>
      )}
      {page !== "recordings" && <DeviceName app={app} />}
    </header>
  );
}

/** Where the controls of time have no place: what the device is doing, and what is on trial. */
function StateTags({ app }: { readonly app: App }) {
  const device = app.device.value;
  const control = device && app.store.control.value.get(device.id);
  const health = device && app.store.health.value.get(device.id);
  if (!device) return null;
  const state = control?.state || markOf(device.status, 0).word;
  const streams = device.status === "live" && health;
  const trial = control?.trial?.state === "asking" ? control.trial : undefined;
  return (
    <>
      <span class="tag desk statetag">
        <span class={`dot ${markOf(device.status, 0).dot}`} />
        {state}
        {streams ? `, ${rate(health.rate)} samples/s` : ""}
      </span>
      {trial && <span class="tag yours desk statetag">{count(trial.changes.length, "change")} on trial</span>}
    </>
  );
}

/** The controls of time; there are none while there is no time to move in. */
function TimeControls({ app }: { readonly app: App }) {
  // Lit is what is live: not a page that nothing comes to, nor a device that is gone.
  const lit = view.value.live && !app.store.isCut && app.device.value?.status === "live";
  return (
    <>
      <div class="seg desk" role="group" aria-label="Play state">
        <button type="button" aria-pressed={view.value.live} title="Follow the newest sample (Space, End)" onClick={() => actions.live()}>
          <span class={lit ? "dot live" : "dot off"} />
          Live
        </button>
        <button type="button" aria-pressed={!view.value.live} title="Freeze the view; nothing else stops (Space)" onClick={() => actions.pause()}>
          <Icon name="pause" />
          Pause
        </button>
      </div>
      <Window class="desk" words />
      <TimeBase />
      <Move />
    </>
  );
}

function Theme() {
  const other = theme.value === "dark" ? "light" : "dark";
  return (
    <button type="button" class="btn icon" aria-label={`Use the ${other} theme`} title={`Use the ${other} theme`} onClick={toggleTheme}>
      <Icon name={theme.value === "dark" ? "sun" : "moon"} />
    </button>
  );
}

interface ToggleProps {
  readonly name: "rail" | "side";
  readonly label: string;
  readonly icon: IconName;
}

/** Opens a panel that is folded because the window is narrow. */
function Toggle({ name, label, icon }: ToggleProps) {
  const open = sheet.value === name;
  return (
    <button
      type="button"
      class={`btn icon desk ${name === "rail" ? "only-narrow" : "only-mid"}`}
      aria-label={label}
      title={label}
      aria-expanded={open}
      aria-controls={name}
      onClick={() => (sheet.value = open ? undefined : name)}
    >
      <Icon name={icon} />
    </button>
  );
}

/** On a phone the devices stand behind the name of the selected one. */
function DeviceName({ app }: { readonly app: App }) {
  const device = app.device.value;
  const mark = device ? markOf(device.status, recently(app, device.id).gaps) : { dot: "off", word: "none" };
  const open = sheet.value === "rail";
  return (
    <button type="button" class="btn phone devname" aria-expanded={open} aria-controls="rail" onClick={() => (sheet.value = open ? undefined : "rail")}>
      <span class={`dot ${mark.dot}`} />
      <span class="vh">{mark.word}: </span>
      <span class="ell">{device?.name ?? "Devices"}</span>
      <Icon name="down" />
    </button>
  );
}

/** The length of the window; a length made by zooming stands in the list as well. */
function Window({ class: name, words = false }: { readonly class: string; readonly words?: boolean }) {
  const current = view.value.span;
  const listed = SPANS.some((seconds) => Math.abs(seconds - current) < 1e-6);
  const all = listed ? SPANS : [...SPANS, current].sort((a, b) => a - b);
  return (
    <label class={`select ${name}`} title="Window length ([ and ])">
      {words && <span aria-hidden="true">Window</span>}
      <select aria-label="Window length" value={String(current)} onChange={(event) => actions.setSpan(Number(event.currentTarget.value))}>
        {all.map((seconds) => (
          <option key={seconds} value={String(seconds)}>
            {span(seconds).value} {span(seconds).unit}
          </option>
        ))}
      </select>
      <Icon name="down" />
    </label>
  );
}

function TimeBase() {
  const device = view.value.timeBase === "device";
  const choose = (wanted: boolean) => () => {
    if (wanted !== device) actions.toggleTimeBase();
  };
  return (
    <div class="seg desk" role="group" aria-label="Time axis">
      <button type="button" aria-pressed={device} title="When it was measured, by the device's clock (T)" onClick={choose(true)}>
        Device time
      </button>
      <button type="button" aria-pressed={!device} title="When its bytes arrived at the host (T)" onClick={choose(false)}>
        Arrival time
      </button>
    </div>
  );
}

interface Step {
  readonly icon: IconName;
  readonly label: string;
  readonly extra: boolean;
  readonly act: () => void;
}

const zoomed = number(ZOOM_STEP, 1);
const STEPS: readonly Step[] = [
  { icon: "first", label: "To the start of what is in memory (Home)", extra: true, act: () => actions.toStart() },
  { icon: "back", label: "Back a tenth of the window (←)", extra: false, act: () => actions.pan(-0.1) },
  { icon: "stepBack", label: "Back one sample (,)", extra: true, act: () => actions.stepSample(-1) },
  { icon: "stepForward", label: "Forward one sample (.)", extra: true, act: () => actions.stepSample(1) },
  { icon: "forward", label: "Forward a tenth of the window (→)", extra: false, act: () => actions.pan(0.1) },
  { icon: "last", label: "To now (End)", extra: true, act: () => actions.live() },
  { icon: "minus", label: `Zoom out ${zoomed} times (−)`, extra: true, act: () => actions.zoom(ZOOM_STEP) },
  { icon: "plus", label: `Zoom in ${zoomed} times (+)`, extra: true, act: () => actions.zoom(1 / ZOOM_STEP) },
  { icon: "fit", label: "Fit all that is in memory (F)", extra: false, act: () => actions.fit() },
];

/** Moving through time by hand; every one is a key as well. */
function Move() {
  return (
    <div class="move desk" role="group" aria-label="Move through time">
      {STEPS.map((step) => (
        <button type="button" key={step.icon} class={`btn icon ${step.extra ? "extra" : ""}`} aria-label={step.label} title={step.label} onClick={step.act}>
          <Icon name={step.icon} />
        </button>
      ))}
    </div>
  );
}

/** The controls of time for a thumb. */
export function Dock() {
  const { live } = view.value;
  return (
    <div class="dock" role="region" aria-label="Time controls">
      <button type="button" class="btn edge icon" aria-label={live ? "Pause" : "Live"} onClick={() => (live ? actions.pause() : actions.live())}>
        <Icon name={live ? "pause" : "play"} />
      </button>
      <Window class="" />
      <button type="button" class="btn edge" aria-label="Time axis: device or arrival time" onClick={() => actions.toggleTimeBase()}>
        {view.value.timeBase === "device" ? "Device" : "Arrival"}
      </button>
      {STEPS.filter((step) => !step.extra).map((step) => (
        <button type="button" key={step.icon} class="btn edge icon" aria-label={step.label} onClick={step.act}>
          <Icon name={step.icon} />
        </button>
      ))}
    </div>
  );
}
