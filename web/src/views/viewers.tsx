/**
 * Viewers of others beside our own panels: the page of one in a frame, started on request and removed when closed.
 *
 * Live it shows one device or all side by side. Over a recording it follows the player.
 */
import { type Signal, signal } from "@preact/signals";
import { fromExtensions } from "../extension/extension";
import type { ReplayController } from "../recordings/replay-controller";
import { perApp } from "../page/app-state";
import type { App } from "../page/context";
import { Button } from "../ui/controls/button";
import { IconButton } from "../ui/controls/icon-button";
import { shownRobot } from "../requests/server-place";
import { shortName } from "../wire/device-name";
import type { DeviceInfo } from "../wire/types";
import { ViewerPanel } from "./viewer-panel";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/viewers";
import type { FunctionComponent } from "preact";
import type { IconName } from "../ui/controls/icons";
import "./viewers.css";

/** The panel, on Live and on recordings. */
const framesOf = perApp(() => ({
  isOpen: signal(false),
  /** All devices side by side instead of the selected one. */
  together: signal(false),
  /** Viewer.id of the viewer in the panel on Live; undefined: the first. */
  chosen: signal<string | undefined>(undefined),
}));

interface Props {
  readonly app: App;
}

/** Viewers in their order. Those are pages of the robot, which the fleet server does not pass on. */
function viewers(): readonly Viewer[] {
  return shownRobot() === undefined ? fromExtensions("viewers").toSorted((a, b) => a.order - b.order) : [];
}

const forRecordings = (): readonly Viewer[] => viewers().filter(({ Recording }) => Recording !== undefined);

/** Opens and closes the panel. */
export function ViewerButton({ app, isLive }: Props & { readonly isLive: boolean }) {
  const { isOpen } = framesOf(app);
  const all = isLive ? viewers() : forRecordings();
  const [first] = all;
  if (!first) return null;
  const open = isOpen.value;
  return (
    <IconButton
      icon={first.icon}
      label={first.title}
      word={first.title}
      class="desk"
      title={
        open
          ? first.close
          : TEXT.showIn(
              viewers()
                .map(({ object }) => object)
                .join(TEXT.orIn),
            )
      }
      aria-pressed={open}
      onClick={() => (isOpen.value = !open)}
    />
  );
}

interface LineProps extends Props {
  readonly viewers: readonly Viewer[];
  readonly children?: preact.ComponentChildren;
}

/** The same on a phone, whose bar has no room for it: a line of its own, with a button for each viewer while the panel is closed. */
function ViewerLine({ app, viewers: all, children }: LineProps) {
  const { isOpen, chosen } = framesOf(app);
  const open = (id: string): void => {
    chosen.value = id;
    isOpen.value = true;
  };
  return (
    <div class="viewer-actions" role="group" aria-label={TEXT.otherViews}>
      {!isOpen.value &&
        all.map(({ id, icon, title }) => (
          <Button look="edge" icon={icon} words={title} key={id} onClick={() => open(id)} />
        ))}
      {children}
    </div>
  );
}

export function RecordingViews({ app, children }: Props & { readonly children: preact.ComponentChildren }) {
  return (
    <ViewerLine app={app} viewers={forRecordings()}>
      {children}
    </ViewerLine>
  );
}

/** On Live: the viewers and help; hidden while the panel is open. */
export function LiveViews({ app }: Props) {
  if (framesOf(app).isOpen.value) return null;
  return (
    <ViewerLine app={app} viewers={viewers()}>
      <Button
        look="edge"
        icon="help"
        words={TEXT.help}
        title={TEXT.gesturesAndKeys}
        onClick={() => (app.overlay.value = "help")}
      />
    </ViewerLine>
  );
}

export function LiveViewer({ app, device }: Props & { readonly device: DeviceInfo }) {
  const { isOpen, together, chosen } = framesOf(app);
  const all = viewers();
  const shown = all.find(({ id }) => id === chosen.value) ?? all[0];
  if (!isOpen.value || !shown) return null;
  const several = app.store.devices.value.length > 1;
  const isAll = several && together.value;
  const id = isAll ? undefined : device.id;
  const choices = (
    <>
      {all.length > 1 && (
        <span class="segmented small" role="group" aria-label={TEXT.viewer}>
          {all.map((one) => (
            <button
              type="button"
              key={one.id}
              aria-pressed={one === shown}
              title={one.choiceHint}
              onClick={() => (chosen.value = one.id)}
            >
              {one.choice}
            </button>
          ))}
        </span>
      )}
      {several && (
        <Button
          look="small"
          words={COMMON.all}
          aria-pressed={isAll}
          title={shown.allHint}
          onClick={() => (together.value = !isAll)}
        />
      )}
    </>
  );
  return (
    <Panel
      isOpen={isOpen}
      title={TEXT.viewOf(shown.title, isAll ? TEXT.allDevicesInTitle : shortName(device))}
      close={shown.close}
      extra={choices}
      address={shown.address(id)}
    >
      <shown.Live key={`${shown.id} ${id ?? ""}`} device={id} />
    </Panel>
  );
}

export function RecordingViewer({ app, replay }: Props & { readonly replay: ReplayController }) {
  const { isOpen } = framesOf(app);
  const [shown] = forRecordings();
  if (!isOpen.value || !shown?.Recording) return null;
  return (
    <Panel isOpen={isOpen} title={shown.recordingTitle ?? shown.title} close={shown.close}>
      <shown.Recording replay={replay} />
    </Panel>
  );
}

interface PanelProps {
  readonly isOpen: Signal<boolean>;
  readonly title: string;
  readonly close: string;
  readonly extra?: preact.ComponentChildren;
  /** Address of the same in a tab of its own. */
  readonly address?: string;
  readonly children: preact.ComponentChildren;
}

function Panel({ isOpen, title, close, ...props }: PanelProps) {
  const linkClass = document.fullscreenEnabled ? "btn small desk" : "btn small";
  const onClose = (): void => void (isOpen.value = false);
  return (
    <ViewerPanel class="viewer" label={title} closeHint={close} onClose={onClose} linkClass={linkClass} {...props} />
  );
}

declare module "../extension/extension" {
  interface Extension {
    /** Viewers that show devices or recordings in a frame. */
    readonly viewers?: readonly Viewer[];
  }
}

interface Viewer {
  readonly id: string;
  /** The first in ascending order is opened first. */
  readonly order: number;
  readonly icon: IconName;
  /** Of its button and its frame: "3D scene". */
  readonly title: string;
  /** Where one is chosen among several: "Scene", with a hint. */
  readonly choice: string;
  readonly choiceHint: string;
  /** As an object of a sentence: "a 3D scene". */
  readonly object: string;
  /** The action that closes it: "Close the 3D scene". */
  readonly close: string;
  /** What showing all devices does. */
  readonly allHint: string;
  /** Title of its frame over a recording. */
  readonly recordingTitle?: string;
  /** Address of its page: of one device, or of all. Reads signals. */
  readonly address: (device: string | undefined) => string;
  /** Its page, of one device or of all. */
  readonly Live: FunctionComponent<{ readonly device: string | undefined }>;
  /** Its page over a recording; absent: it shows none in the frame. */
  readonly Recording?: FunctionComponent<{ readonly replay: ReplayController }>;
}
