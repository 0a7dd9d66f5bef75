/** The Questions page: SQL about the recordings of a store, and its answer as a table or a picture. Loaded on first use. */
import { useEffect, useCallback, useRef } from "preact/hooks";
import type { App } from "../../../page/context";
import { OfflineBand, ProblemBand } from "../../../pages/empty-states";
import { go, route } from "../../../page/route";
import { TopBar } from "../../../pages/top-bar";
import { placeHref } from "../../../page/permalink";
import { Button } from "../../../ui/controls/button";
import { OptionList, Segmented, type ChoiceOption } from "../../../ui/controls/choices";
import { copyText } from "../../../ui/dom/copy";
import { download } from "../../../ui/dom/download";
import { Help } from "../../../pages/help";
import { Icon } from "../../../ui/controls/icons";
import { Message } from "../../../ui/controls/message";
import { request } from "../../../requests/http";
import { Answered } from "../../../requests/use-answer";
import type { QueryAnswer } from "../../../wire/routes";
import { answerCsv, sorted, type Opening } from "./answer";
import { AnswerHistogram, AnswerPlot } from "./chart";
import { questionLink, questionsOf, type FileFormat, type Questions, type QuestionView } from "./state";
import { AnswerTable } from "./table";
import { COMMON } from "../../../texts/common";
import { TEXT as PAGES } from "../texts";
import { TEXT } from "./texts";
import { CompletionList, completed } from "../../../ui/completion/completion-list";
import { MarkedMistake } from "../../../ui/completion/mistake";
import { useCompletion } from "../../../ui/completion/use-completion";
import { completionsOfSql, placeOfMistake } from "./completion";
import "./questions.css";

const [AROUND_S, MINUTE_S] = [10, 60];
const FORMATS: readonly FileFormat[] = ["csv", "parquet", "arrow"];
const VIEWS: readonly QuestionView[] = ["table", "plot", "histogram"];

export function QuestionsPage({ app }: { readonly app: App }) {
  const state = questionsOf(app);
  const query = route.value.query ?? "";
  useEffect(() => {
    document.title = TEXT.questionsImuscope;
    void state.load();
  }, [state]);
  useEffect(() => {
    const text = new URLSearchParams(query).get("sql");
    if (text) state.sql.value = text;
  }, [state, query]);
  const offline = app.store.connection.value === "closed" || app.store.silentSince.value !== undefined;
  const shown = state.shown.value;
  return (
    <div class={`app plain questions ${offline ? "offline" : ""}`}>
      <a class="btn edge skip" href="#question">
        {TEXT.skipToTheEditor}
      </a>
      <TopBar app={app} />
      {offline && <OfflineBand app={app} />}
      <main class="questions-page flex-column">
        <h1 class="visually-hidden">{PAGES.questions}</h1>
        <ProblemBand app={app} />
        <Sources state={state} />
        <QuestionEditor state={state} />
        <Actions app={app} state={state} />
        {/* the problem stands beside the editor */}
        <Answered
          of={{ ...shown, problem: undefined }}
          waiting={state.problem.value === undefined && <Start state={state} />}
        >
          {(found) => <Answer app={app} state={state} answer={found} />}
        </Answered>
      </main>
      {app.overlay.value === "help" && <Help onClose={() => (app.overlay.value = undefined)} />}
    </div>
  );
}

interface MenuProps<T extends string> {
  readonly title: string;
  readonly options: readonly ChoiceOption<T>[];
  readonly onChoose: (value: T) => void;
}

/** A list of which each entry does something once: it shows its title again. */
function Menu<T extends string>({ title, options, onChoose }: MenuProps<T>) {
  return (
    <label
      class="select"
      onChange={({ target }) => {
        if (target instanceof HTMLSelectElement) target.value = "";
      }}
    >
      <span class="visually-hidden">{title}</span>
      <OptionList value="" none={title} options={options} onChoose={onChoose} />
      <Icon name="down" />
    </label>
  );
}

/** Texts to start from: prepared questions, and those asked before. */
function Sources({ state }: { readonly state: Questions }) {
  const { prepared, history, sql } = state;
  return (
    <div class="question-sources control-row">
      <Menu
        title={TEXT.prepared}
        options={prepared.value.map(({ name, title }) => [name, title])}
        onChoose={(chosen) => {
          sql.value = prepared.peek().find(({ name }) => name === chosen)?.sql ?? sql.peek();
        }}
      />
      {history.value.length > 0 && (
        <Menu
          title={TEXT.history}
          options={[
            ...history.value.map((text, at) => [String(at), text.replace(/\s+/g, " ").slice(0, 90)] as const),
            ["clear", TEXT.clearHistory],
          ]}
          onChoose={(chosen) => {
            if (chosen === "clear") state.forget();
            else sql.value = history.peek()[Number(chosen)] ?? sql.peek();
          }}
        />
      )}
      <span class="grow" />
      {state.store.value && (
        <span class="dim ellipsis question-store text-sm">{TEXT.aboutStore(state.store.value)}</span>
      )}
    </div>
  );
}

function Actions({ app, state }: { readonly app: App; readonly state: Questions }) {
  const { running, problem, shown, notice, sql } = state;
  void app.tick.value; // the time that a question has run
  const now = running.value;
  const seconds = now ? ((performance.now() - now.since) / 1000).toFixed(0) : "";
  const given = shown.value.isOld ? undefined : shown.value.answer;
  const status = now
    ? now.before === undefined
      ? TEXT.running(seconds)
      : TEXT.waiting(now.before, seconds)
    : notice.value || (given && !problem.value ? summary(given) : "");
  return (
    <div class="control-row">
      {now ? (
        <Button
          look="edge"
          icon="close"
          words={TEXT.cancel}
          title={TEXT.cancelHint}
          onClick={() => {
            state.cancel();
            notice.value = TEXT.cancelled;
          }}
        />
      ) : (
        <Button
          look="main"
          icon="play"
          words={TEXT.ask}
          title={TEXT.askHint}
          disabled={sql.value.trim() === ""}
          onClick={() => void state.run()}
        />
      )}
      <Button
        look="edge"
        icon="share"
        words={TEXT.copyLink}
        title={TEXT.copyLinkHint}
        disabled={sql.value.trim() === ""}
        onClick={() => {
          const link = new URL(questionLink(sql.peek().trim()), location.href).href;
          void copyText(link).then((done) => (notice.value = done ? COMMON.copied : COMMON.notCopied));
        }}
      />
      <p class="question-status mid text-sm" role="status">
        {status}
      </p>
      <p id="question-problem" class="question-problem" role="alert">
        {problem.value && (
          <>
            <Message text={problem.value.message} />{" "}
            {problem.value.hint && <span class="dim">{problem.value.hint}</span>}
          </>
        )}
      </p>
    </div>
  );
}

function summary({ rows, more, seconds }: QueryAnswer): string {
  return more ? TEXT.firstRows(rows.length, seconds.toFixed(1)) : TEXT.answered(rows.length, seconds.toFixed(1));
}

function Start({ state }: { readonly state: Questions }) {
  return (
    <section class="question-start">
      <p>{TEXT.start}</p>
      <p class="dim">{TEXT.startHint}</p>
      <ul>
        {state.prepared.value.map(({ name, title, sql }) => (
          <li key={name}>
            <Button
              look="edge"
              words={title.charAt(0).toUpperCase() + title.slice(1)}
              onClick={() => {
                state.sql.value = sql;
                void state.run();
              }}
            />
          </li>
        ))}
      </ul>
    </section>
  );
}

interface AnswerProps {
  readonly app: App;
  readonly state: Questions;
  readonly answer: QueryAnswer;
}

function Answer({ app, state, answer }: AnswerProps) {
  const { view, notice } = state;
  const open = (one: Opening): void => void openRecording(app, state, one);
  const copy = (): void => {
    const text = answerCsv(answer, sorted(answer.rows, state.order.peek()));
    void copyText(text).then((done) => (notice.value = done ? COMMON.copied : COMMON.notCopied));
  };
  return (
    <section class="query-answer flex-column" aria-label={TEXT.answer}>
      <div class="answer-tools control-row">
        <Segmented
          label={TEXT.view}
          value={view.value}
          options={VIEWS.map((one) => [one, TEXT.views[one]])}
          onChoose={(one) => (view.value = one)}
        />
        <span class="grow" />
        <Button look="edge" words={TEXT.copy} onClick={copy} />
        <Menu
          title={TEXT.download}
          options={FORMATS.map((one) => [one, TEXT.formats[one]])}
          onChoose={(format) => void downloadAnswer(state, format)}
        />
      </div>
      {answer.rows.length === 0 ? (
        <p class="answer-none dim">{TEXT.noRows}</p>
      ) : view.value === "table" ? (
        <AnswerTable state={state} answer={answer} open={open} />
      ) : view.value === "plot" ? (
        <AnswerPlot state={state} answer={answer} />
      ) : (
        <AnswerHistogram state={state} answer={answer} />
      )}
    </section>
  );
}

async function downloadAnswer(state: Questions, format: FileFormat): Promise<void> {
  state.notice.value = TEXT.downloading(TEXT.formats[format]);
  const blob = await state.file(format);
  state.notice.value = "";
  if (!blob) return;
  const address = URL.createObjectURL(blob);
  download(address, `answer.${format}`);
  URL.revokeObjectURL(address);
}

/** Opens a recording of the store at a moment; it is fetched into the library of this server first, if it is not there. */
async function openRecording(app: App, state: Questions, { recording, at, isMinute }: Opening): Promise<void> {
  state.notice.value = TEXT.fetching(recording);
  const outcome = await request("POST /api/query/recordings/{recording}/fetch", { path: { recording } });
  state.notice.value = "";
  if (!outcome.ok) {
    state.failed.value = outcome.problem;
    return;
  }
  app.problem.value = undefined;
  const { id } = outcome.value;
  if (at === undefined) {
    go("recordings", id);
    return;
  }
  const range = isMinute ? { t0: at, t1: at + MINUTE_S } : { t0: at - AROUND_S, t1: at + AROUND_S, cursor: at };
  location.hash = placeHref(id, { ...range, hide: [], show: [], panels: [] });
}

const [LEAST_LINES, MOST_LINES] = [4, 14];

/** The editor of a question: completion at the caret, Ctrl+Enter, and the place of a mistake. */
function QuestionEditor({ state }: { readonly state: Questions }) {
  const { sql, words, problem } = state;
  const area = useRef<HTMLTextAreaElement>(null);
  const isTyping = useRef(false);
  const find = useCallback((typed: string, caret: number) => completionsOfSql(typed, caret, words.peek()), [words]);
  const offer = useCompletion(area, sql, find);
  useEffect(() => {
    if (words.value && isTyping.current) offer.open(); // they came after a letter was typed
  }, [words.value, offer]);
  const end = (): void => {
    isTyping.current = false;
    offer.close();
  };
  const onKey = (event: KeyboardEvent): void => {
    const { key } = event;
    if (offer.onKey(event)) return;
    if (key === "Enter" && (event.ctrlKey || event.metaKey)) {
      event.preventDefault();
      end();
      void state.run();
    } else if (key === "Escape") {
      event.stopPropagation();
      state.cancel();
    } else if (key === " " && event.ctrlKey) {
      event.preventDefault();
      offer.open();
    }
  };
  const lines = Math.min(MOST_LINES, Math.max(LEAST_LINES, sql.value.split("\n").length));
  const place = problem.value?.kind === "bad-query" ? placeOfMistake(problem.value.message, sql.value) : undefined;
  return (
    <div class="question-editor">
      <textarea
        ref={area}
        id="question"
        rows={lines}
        aria-label={TEXT.editor}
        {...completed("question-words", offer)}
        aria-invalid={place !== undefined}
        aria-describedby="question-problem"
        placeholder={TEXT.rowsFromStart}
        spellcheck={false}
        autocomplete="off"
        autocapitalize="off"
        wrap="soft"
        value={sql.value}
        onInput={(event) => {
          sql.value = event.currentTarget.value;
          isTyping.current = true;
          offer.open();
        }}
        onKeyDown={onKey}
        onBlur={end}
      />
      <CompletionList id="question-words" offer={offer} />
      {place !== undefined && <MistakeLine text={sql.value} at={place} />}
    </div>
  );
}

/** The line of a mistake, marked from its place to the end of the word there. */
function MistakeLine({ text, at }: { readonly text: string; readonly at: number }) {
  const begin = text.lastIndexOf("\n", at - 1) + 1;
  const end = text.indexOf("\n", at);
  const word = /^(\w+|"[^"]*"|.)/.exec(text.slice(at))?.[0] ?? "";
  return (
    <div class="question-mistake" aria-hidden="true">
      <MarkedMistake
        text={text.slice(begin, end < 0 ? undefined : end)}
        begin={at - begin}
        end={at - begin + word.length}
      />
    </div>
  );
}
