/**
 * The 3D scene beside our own panels: viser's page in a frame, begun when a person asks for it and gone when it is closed. Live the
 * same place holds Rerun's viewer, for who prefers that.
 *
 * Live it shows one device or all side by side. Of a recording it follows the player: the page says where it reads whenever that
 * changes otherwise than by playing on, and once a second, so that both stay together.
 */
import { signal } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import { onFrame } from "../data/render-loop";
import type { Replay } from "../recordings/replay-controller";
import { overlay } from "../pages/app-state";
import { type Problem, request } from "../ui/http";
import { Icon } from "../ui/icons";
import { Message } from "../ui/message";
import { theme } from "../ui/theme";
import type { DeviceInfo } from "../wire/types";
import { headNews, type Told } from "./viewer-sync";
import { liveHref } from "./viewer-href";
import "./viser.css";

/** Is the panel open? The same on every page. */
export const sceneOpen = signal(false);
/** All devices side by side instead of the selected one. */
const together = signal(false);
/** Whose viewer stands in the panel on Live. */
const viewer = signal<"viser" | "rerun">("viser");

/** Opens and closes the panel. */
export function SceneButton() {
  const open = sceneOpen.value;
  return (
    <button
      type="button"
      class="btn icon desk"
      aria-label="3D scene"
      title={open ? "Close the 3D scene" : "Show it in a 3D scene, or in Rerun"}
      aria-pressed={open}
      onClick={() => (sceneOpen.value = !open)}
    >
      <Icon name="cube" />
    </button>
  );
}

/** The same on a phone, whose bar has no room for it: a line of its own, gone while the panel is open. */
export function SceneLine({ children }: { readonly children?: preact.ComponentChildren }) {
  return (
    <div class="sceneline" role="group" aria-label="Other views">
      {!sceneOpen.value && (
        <button type="button" class="btn edge" onClick={() => (sceneOpen.value = true)}>
          <Icon name="cube" />
          3D scene
        </button>
      )}
      {children}
    </div>
  );
}

/** On Live: the scene, or Rerun at once. */
export function LiveViews() {
  if (sceneOpen.value) return null;
  const rerun = (): void => {
    viewer.value = "rerun";
    sceneOpen.value = true;
  };
  return (
    <SceneLine>
      <button type="button" class="btn edge" onClick={rerun}>
        <Icon name="wave" />
        Rerun
      </button>
      <button type="button" class="btn edge" title="Gestures and keys" onClick={() => (overlay.value = "help")}>
        <Icon name="help" />
        Help
      </button>
    </SceneLine>
  );
}

/** The panel on Live. */
export function LiveScene({ device, several }: { readonly device: DeviceInfo; readonly several: boolean }) {
  if (!sceneOpen.value) return null;
  const all = several && together.value;
  const key = all ? "" : device.id;
  const isRerun = viewer.value === "rerun";
  const choices = (
    <>
      <span class="seg small" role="group" aria-label="Viewer">
        <button type="button" aria-pressed={!isRerun} title="Body, axes, track: drawn by viser" onClick={() => (viewer.value = "viser")}>
          Scene
        </button>
        <button type="button" aria-pressed={isRerun} title="Body and curves as they come, in the Rerun viewer" onClick={() => (viewer.value = "rerun")}>
          Rerun
        </button>
      </span>
      {several && (
        <button type="button" class="btn small" aria-pressed={all} title={isRerun ? "All devices" : "All devices, side by side"} onClick={() => (together.value = !all)}>
          All
        </button>
      )}
    </>
  );
  const address = isRerun ? liveHref(all ? undefined : device.id, theme.value) : key ? `/viser/${key}/` : "/viser/";
  return (
    <Panel title={`${isRerun ? "Rerun" : "3D scene"} of ${all ? "all devices" : device.name}`} extra={choices} address={address}>
      {isRerun ? <Frame key={address} address={address} title="Rerun viewer" /> : <Begun key={key} device={key} />}
    </Panel>
  );
}

/** The panel of a recording that is open. */
export function ReplayScene({ replay }: { readonly replay: Replay }) {
  if (!sceneOpen.value) return null;
  return (
    <Panel title="3D scene of the recording">
      <Following replay={replay} />
    </Panel>
  );
}

interface PanelProps {
  readonly title: string;
  readonly extra?: preact.ComponentChildren;
  /** Where the same is seen in a tab of its own. */
  readonly address?: string;
  readonly children: preact.ComponentChildren;
}

function Panel({ title, extra, address, children }: PanelProps) {
  const whole = useRef<HTMLElement>(null);
  const enlarge = (): void => {
    if (document.fullscreenElement) void document.exitFullscreen();
    else void whole.current?.requestFullscreen?.().catch(() => undefined);
  };
  return (
    <section class="scene" ref={whole} aria-label={title}>
      <div class="head">
        <h2>{title}</h2>
        <span class="grow" />
        {extra}
        {address && (
          <a class={document.fullscreenEnabled ? "btn small desk" : "btn small"} href={address} target="_blank" rel="noopener" title="Open it in a tab of its own; its address can be shared">
            Own tab
          </a>
        )}
        {document.fullscreenEnabled && (
          <button type="button" class="btn icon" aria-label="Full screen" title="Full screen, and back (Esc)" onClick={enlarge}>
            <Icon name="fit" />
          </button>
        )}
        <button type="button" class="btn icon" aria-label="Close the 3D scene" title="Close the 3D scene" onClick={() => (sceneOpen.value = false)}>
          <Icon name="close" />
        </button>
      </div>
      {children}
    </section>
  );
}

function Frame({ address, title }: { readonly address: string; readonly title: string }) {
  return <iframe src={address} title={title} allow="fullscreen" />;
}

function Scene({ address }: { readonly address: string }) {
  const dark = theme.value === "dark" ? "?darkMode" : "";
  return <Frame address={address + dark} title="3D scene, by viser" />;
}

function Waiting({ problem }: { readonly problem: Problem | undefined }) {
  if (!problem) return <p class="wait" role="status">Starting the 3D scene…</p>;
  return (
    <p class="wait" role="alert">
      <b><Message text={problem.message} /></b> <Message text={problem.hint} />
    </p>
  );
}

/** A scene of what lives: asked for first, so that a refusal is told in words of ours. */
function Begun({ device }: { readonly device: string }) {
  const [address, setAddress] = useState<string>();
  const [problem, setProblem] = useState<Problem>();
  useEffect(() => {
    let wanted = true;
    void request<{ readonly address: string }>("GET", `/api/views/scene?device=${encodeURIComponent(device)}`).then((outcome) => {
      if (!wanted) return;
      if (outcome.ok) setAddress(outcome.value.address);
      else setProblem(outcome.problem);
    });
    return () => {
      wanted = false;
    };
  }, []);
  return address === undefined ? <Waiting problem={problem} /> : <Scene address={address} />;
}

/** A scene that follows a player. */
function Following({ replay }: { readonly replay: Replay }) {
  const [address, setAddress] = useState<string>();
  const [problem, setProblem] = useState<Problem>();
  useEffect(() => {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/ws/scene/${encodeURIComponent(replay.detail.info.id)}`);
    let told: Told | undefined;
    socket.onmessage = ({ data }) => setAddress((JSON.parse(String(data)) as { readonly address: string }).address);
    socket.onclose = ({ reason }) => {
      setAddress(undefined);
      setProblem({ kind: "closed", message: reason || "The 3D scene has ended.", hint: "Close it and open it again.", status: 0 });
    };
    const stop = onFrame((now) => {
      if (socket.readyState !== WebSocket.OPEN) return;
      const rate = replay.playing.peek() ? replay.speed.peek() : 0;
      const news = headNews(told, { t: replay.head, rate, at: now / 1000 });
      if (!news) return;
      told = news;
      socket.send(JSON.stringify({ t: news.t, rate: news.rate }));
    });
    return () => {
      stop();
      socket.onclose = null;
      socket.close();
    };
  }, []);
  return address === undefined ? <Waiting problem={problem} /> : <Scene address={address} />;
}
