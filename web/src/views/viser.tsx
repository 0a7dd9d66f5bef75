/**
 * The 3D scene beside our own panels: viser's page in a frame, started on request and removed when closed. Live the same place holds
 * Rerun's viewer as an alternative.
 *
 * Live it shows one device or all side by side. For a recording it follows the player: the page sends the reading position whenever
 * it changes otherwise than by playback, and once a second, so that both stay in step.
 */
import { type Signal, signal } from "@preact/signals";
import type { ReplayController } from "../recordings/replay-controller";
import { type App, perApp } from "../pages/app-state";
import { IconButton } from "../ui/icon-button";
import { Icon } from "../ui/icons";
import { shownRobot } from "../ui/server-place";
import { theme } from "../ui/theme";
import { shortName } from "../wire/device-name";
import type { DeviceInfo } from "../wire/types";
import { Begun, Following, Frame } from "./scene-frame";
import { liveHref } from "./viewer-href";
import { ViewerPanel } from "./viewer-panel";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/viewers";
import "./viser.css";

/** The panel, on Live and on recordings. */
const sceneOf = perApp(() => ({
  isOpen: signal(false),
  /** All devices side by side instead of the selected one. */
  together: signal(false),
  /** The viewer in the panel on Live. */
  viewer: signal<"viser" | "rerun">("viser"),
}));

interface Props {
  readonly app: App;
}

/** Opens and closes the panel. */
export function SceneButton({ app }: Props) {
  const { isOpen } = sceneOf(app);
  if (shownRobot() !== undefined) return null; // viewers of others are pages of the robot, which the fleet server does not pass on
  const open = isOpen.value;
  return (
    <IconButton
      icon="cube"
      label={TEXT.scene3d}
      class="desk"
      title={open ? TEXT.closeScene : TEXT.openScene}
      aria-pressed={open}
      onClick={() => (isOpen.value = !open)}
    />
  );
}

/** The same on a phone, whose bar has no room for it: a line of its own, hidden while the panel is open. */
export function SceneLine({ app, children }: Props & { readonly children?: preact.ComponentChildren }) {
  const { isOpen } = sceneOf(app);
  const isNear = shownRobot() === undefined;
  return (
    <div class="scene-actions" role="group" aria-label={TEXT.otherViews}>
      {isNear && !isOpen.value && (
        <button type="button" class="btn edge" onClick={() => (isOpen.value = true)}>
          <Icon name="cube" />
          {TEXT.scene3d}
        </button>
      )}
      {children}
    </div>
  );
}

/** On Live: the scene, or Rerun at once. */
export function LiveViews({ app }: Props) {
  const { isOpen, viewer } = sceneOf(app);
  if (isOpen.value) return null;
  const rerun = (): void => {
    viewer.value = "rerun";
    isOpen.value = true;
  };
  return (
    <SceneLine app={app}>
      {shownRobot() === undefined && (
        <button type="button" class="btn edge" onClick={rerun}>
          <Icon name="wave" />
          {TEXT.rerun}
        </button>
      )}
      <button type="button" class="btn edge" title={TEXT.gesturesAndKeys} onClick={() => (app.overlay.value = "help")}>
        <Icon name="help" />
        {TEXT.help}
      </button>
    </SceneLine>
  );
}

/** The panel on Live. */
export function LiveScene({ app, device }: Props & { readonly device: DeviceInfo }) {
  const { isOpen, together, viewer } = sceneOf(app);
  if (!isOpen.value) return null;
  const several = app.store.devices.value.length > 1;
  const all = several && together.value;
  const key = all ? "" : device.id;
  const isRerun = viewer.value === "rerun";
  const choices = (
    <>
      <span class="segmented small" role="group" aria-label={TEXT.viewer}>
        <button type="button" aria-pressed={!isRerun} title={TEXT.sceneHint} onClick={() => (viewer.value = "viser")}>
          {TEXT.scene}
        </button>
        <button type="button" aria-pressed={isRerun} title={TEXT.rerunHint} onClick={() => (viewer.value = "rerun")}>
          {TEXT.rerun}
        </button>
      </span>
      {several && (
        <button
          type="button"
          class="btn small"
          aria-pressed={all}
          title={isRerun ? TEXT.allDevices : TEXT.allDevicesSideBySide}
          onClick={() => (together.value = !all)}
        >
          {COMMON.all}
        </button>
      )}
    </>
  );
  const address = isRerun ? liveHref(all ? undefined : device.id, theme.value) : key ? `/viser/${key}/` : "/viser/";
  return (
    <Panel
      isOpen={isOpen}
      title={TEXT.viewOf(isRerun ? TEXT.rerun : TEXT.scene3d, all ? TEXT.allDevicesInTitle : shortName(device))}
      extra={choices}
      address={address}
    >
      {isRerun ? <Frame key={address} address={address} title={TEXT.rerunViewer} /> : <Begun key={key} device={key} />}
    </Panel>
  );
}

/** The panel of a recording that is open. */
export function ReplayScene({ app, replay }: Props & { readonly replay: ReplayController }) {
  const { isOpen } = sceneOf(app);
  if (!isOpen.value) return null;
  return (
    <Panel isOpen={isOpen} title={TEXT.sceneOfRecording}>
      <Following
        player={{
          recording: replay.detail.info.id,
          head: () => replay.head,
          rate: () => (replay.playing.peek() ? replay.speed.peek() : 0),
        }}
      />
    </Panel>
  );
}

interface PanelProps {
  readonly isOpen: Signal<boolean>;
  readonly title: string;
  readonly extra?: preact.ComponentChildren;
  /** Address of the same in a tab of its own. */
  readonly address?: string;
  readonly children: preact.ComponentChildren;
}

function Panel({ isOpen, title, ...props }: PanelProps) {
  const linkClass = document.fullscreenEnabled ? "btn small desk" : "btn small";
  const onClose = (): void => void (isOpen.value = false);
  return (
    <ViewerPanel
      class="scene"
      label={title}
      closeHint={TEXT.closeScene}
      onClose={onClose}
      linkClass={linkClass}
      {...props}
    />
  );
}
