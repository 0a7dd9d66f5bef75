/** The panel of a file: which clock is the time axis and why, and all clocks with their figures and steps. */
import { useSignal } from "@preact/signals";
import type { FileClock, FileTime } from "../../wire/routes";
import type { Deps } from "../../page/context";
import { Button } from "../../ui/controls/button";
import type { Panel } from "../../ui/dom/dom";
import { type HttpProblem, request } from "../../requests/http";
import { ProblemNote } from "../../requests/problem-note";
import { Answered, useAnswer } from "../../requests/use-answer";
import { renderedPanel } from "../../panels/panel-host";
import { Clocks } from "./clocks";
import { readingOf, withTimes } from "./reading";
import { reopen } from "./reopen";
import { TEXT } from "./texts";
import "./file-time.css";

export function mountClocks(host: HTMLElement, deps: Deps): Panel {
  return renderedPanel(host, <ClocksPanel deps={deps} />);
}

export function ClocksPanel({ deps }: { readonly deps: Deps }) {
  const id = deps.recording?.id ?? "";
  const file = useAnswer(id, (signal) =>
    request("GET /api/recordings/{recording}/clocks", { path: { recording: id }, signal }),
  );
  return (
    <Answered of={file} waiting={<p class="foot-note dim">{TEXT.loading}</p>}>
      {(time) => <ClocksOf time={time} id={id} deps={deps} />}
    </Answered>
  );
}

interface ClocksProps {
  readonly time: FileTime;
  readonly id: string;
  readonly deps: Deps;
}

function ClocksOf({ time, id, deps }: ClocksProps) {
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const sentences = time.sentences.length > 0 ? time.sentences : [TEXT.ofDevice];
  const use = async (clock: FileClock): Promise<void> => {
    const { reading, is_table } = time;
    problem.value = undefined;
    const choice = clock.use === "arrival" ? ("arrival" as const) : ("" as const);
    const body = is_table ? withTimes(readingOf(reading), clock.use) : { ...reading, clock: choice };
    const outcome = await request("PUT /api/recordings/{recording}/reading", { path: { recording: id }, body });
    if (outcome.ok) reopen(id);
    else if (is_table) deps.open.dialog("file-time/reading", { ...time, reading: body });
    else problem.value = outcome.problem;
  };
  const automatic = async (): Promise<void> => {
    problem.value = undefined;
    const outcome = await request("DELETE /api/recordings/{recording}/reading", { path: { recording: id } });
    if (outcome.ok) reopen(id);
    else problem.value = outcome.problem;
  };
  return (
    <div class="file-time">
      {sentences.map((sentence) => (
        <p key={sentence}>{sentence}</p>
      ))}
      {(time.is_table || time.is_chosen) && (
        <div class="control-row">
          {time.is_chosen && (
            <span class="dim">{time.is_table ? TEXT.isChosen : `${TEXT.isChosen} ${TEXT.notPlayed}`}</span>
          )}
          {time.is_table && (
            <Button
              changes
              look="small edge"
              words={TEXT.readOtherwise}
              title={TEXT.readOtherwiseHint}
              onClick={() => deps.open.dialog("file-time/reading", time)}
            />
          )}
          {time.is_chosen && (
            <Button
              changes
              look="small edge"
              words={TEXT.automatic}
              title={time.is_table ? TEXT.automaticHint : TEXT.automaticClock}
              onClick={() => void automatic()}
            />
          )}
        </div>
      )}
      {problem.value && <ProblemNote problem={problem.value} />}
      {time.messages.map((one) => (
        <Clocks
          key={`${one.device} ${one.message}`}
          of={one}
          span={time}
          jump={deps.jump}
          onUse={(clock) => void use(clock)}
        />
      ))}
    </div>
  );
}
