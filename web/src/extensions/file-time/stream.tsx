/** The panel of a live device: the clocks of its stream over the bytes in memory, measured when it is shown and on request. */
import { useSignal } from "@preact/signals";
import type { Deps } from "../../page/context";
import { Button } from "../../ui/controls/button";
import type { Panel } from "../../ui/dom/dom";
import { request } from "../../requests/http";
import { Answered, useAnswer } from "../../requests/use-answer";
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
  const turn = useSignal(0);
  const { viewState } = deps;
  const device = viewState.device.value ?? "";
  const time = useAnswer(device && `${device} ${turn.value}`, (signal) =>
    request("GET /api/devices/{device}/clocks", { path: { device }, signal }),
  );
  const jump: Deps["jump"] = ({ t0, t1 }) => {
    onJump?.();
    viewState.actions.centreAt((t0 + t1) / 2);
    viewState.actions.pin((t0 + t1) / 2);
  };
  const { answer, isBusy } = time;
  return (
    <div class="file-time">
      <div class="control-row" role="status">
        <span>{isBusy ? TEXT.measuring : answer ? TEXT.spanOf(shortDuration(answer.end - answer.start)) : ""}</span>
        <Button look="small edge" words={TEXT.again} disabled={isBusy} onClick={() => turn.value++} />
      </div>
      <Answered of={time}>
        {(found) => (
          <>
            {found.sentences.map((sentence) => (
              <p key={sentence}>{sentence}</p>
            ))}
            {found.messages.map((one) => (
              <Clocks key={`${one.device} ${one.message}`} of={one} span={found} jump={jump} />
            ))}
          </>
        )}
      </Answered>
    </div>
  );
}
