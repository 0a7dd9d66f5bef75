/** The panel of a live device: the clocks of its stream over the bytes in memory, measured when it is shown and on request. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Deps } from "../../page/context";
import { Button } from "../../ui/controls/button";
import type { Panel } from "../../ui/dom/dom";
import { type HttpProblem, request } from "../../requests/http";
import { ProblemNote } from "../../requests/problem-note";
import type { LiveTime } from "../../wire/routes";
import { renderedPanel } from "../../panels/panel-host";
import { Clocks } from "./clocks";
import { shortDuration } from "./duration";
import { TEXT } from "./texts";
import "./file-time.css";

export function mountStream(host: HTMLElement, deps: Deps): Panel {
  return renderedPanel(host, <StreamPanel deps={deps} />);
}

interface Props {
  readonly deps: Deps;
  /** Called before the plots show a moment. */
  readonly onJump?: () => void;
}

export function StreamPanel({ deps, onJump }: Props) {
  const time = useSignal<LiveTime | undefined>(undefined);
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const isBusy = useSignal(false);
  const turn = useSignal(0);
  const { viewState } = deps;
  const device = viewState.device.value ?? "";
  useEffect(() => {
    time.value = undefined;
  }, [device]);
  useEffect(() => {
    if (device === "") return;
    const over = new AbortController();
    isBusy.value = true;
    void request("GET /api/devices/{device}/clocks", { path: { device }, signal: over.signal }).then((outcome) => {
      if (over.signal.aborted) return;
      isBusy.value = false;
      problem.value = outcome.ok ? undefined : outcome.problem;
      if (outcome.ok) time.value = outcome.value;
    });
    return () => over.abort();
  }, [device, turn.value]);
  const jump: Deps["jump"] = ({ t0, t1 }) => {
    onJump?.();
    viewState.actions.centreAt((t0 + t1) / 2);
    viewState.actions.pin((t0 + t1) / 2);
  };
  const found = time.value;
  return (
    <div class="file-time">
      <div class="control-row" role="status">
        <span>{isBusy.value ? TEXT.measuring : found ? TEXT.spanOf(shortDuration(found.end - found.start)) : ""}</span>
        <Button look="small edge" words={TEXT.again} disabled={isBusy.value} onClick={() => turn.value++} />
      </div>
      {problem.value && <ProblemNote problem={problem.value} />}
      {found?.sentences.map((sentence) => (
        <p key={sentence}>{sentence}</p>
      ))}
      {found?.messages.map((one) => (
        <Clocks key={`${one.device} ${one.message}`} of={one} span={found} jump={jump} />
      ))}
    </div>
  );
}
