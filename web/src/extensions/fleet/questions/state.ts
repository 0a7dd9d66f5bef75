/** State of the page of questions: the text, the question that runs, its answer, and what was asked before in this browser. */
import { computed, type ReadonlySignal, type Signal, signal } from "@preact/signals";
import { perApp } from "../../../page/app-state";
import type { App } from "../../../page/context";
import { href } from "../../../page/route";
import { request, respond, type HttpProblem, type Outcome, UNREACHED } from "../../../requests/http";
import { LatestAnswer, type Shown } from "../../../requests/latest-answer";
import type { PreparedQuestionInfo, QueryAnswer, QueryWords } from "../../../wire/routes";
import type { Order } from "./answer";
import { type ChartChoice, firstChoice, numbersOf } from "./chart-data";

export type QuestionView = "table" | "plot" | "histogram";
export type FileFormat = "csv" | "parquet" | "arrow";

export interface Running {
  /** Milliseconds of `performance.now`. */
  readonly since: number;
  /** Questions before this one while it waits; undefined once it runs. */
  readonly before: number | undefined;
}

export interface Questions {
  readonly sql: Signal<string>;
  readonly store: Signal<string>;
  readonly prepared: Signal<readonly PreparedQuestionInfo[]>;
  readonly words: Signal<QueryWords | undefined>;
  readonly history: Signal<readonly string[]>;
  readonly running: Signal<Running | undefined>;
  /** The answer to the text in the editor, or dimmed that to another one. */
  readonly shown: ReadonlySignal<Shown<QueryAnswer>>;
  /** Why the question was refused, or what was done besides. */
  readonly problem: ReadonlySignal<HttpProblem | undefined>;
  readonly failed: Signal<HttpProblem | undefined>;
  /** A sentence about the last action. */
  readonly notice: Signal<string>;
  readonly view: Signal<QuestionView>;
  readonly order: Signal<Order | undefined>;
  readonly choice: Signal<ChartChoice | undefined>;
  readonly column: Signal<number>;
  /** Reads what the editor completes, and the prepared questions. */
  load(): Promise<void>;
  run(): Promise<void>;
  cancel(): void;
  /** All rows as a file; undefined after a problem, which is shown. */
  file(format: FileFormat): Promise<Blob | undefined>;
  forget(): void;
}

export const ROWS = 20_000;
const ASK_AGAIN_MS = 1000;
const MAX_QUESTIONS = 30;
const HISTORY = "imuscope.questions";
const LONGEST_LINK = 6000;

export const questionsOf: (app: App) => Questions = perApp(createQuestions);

function createQuestions(): Questions {
  const sql = signal("");
  const store = signal("");
  const prepared = signal<readonly PreparedQuestionInfo[]>([]);
  const words = signal<QueryWords | undefined>(undefined);
  const history = signal(readHistory());
  const running = signal<Running | undefined>(undefined);
  const latest = new LatestAnswer<QueryAnswer>();
  const shown = computed(() => latest.of(sql.value.trim()));
  let answered = "";
  const failed = signal<HttpProblem | undefined>(undefined);
  const problem = computed(() => failed.value ?? shown.value.problem);
  const notice = signal("");
  const view = signal<QuestionView>("table");
  const order = signal<Order | undefined>(undefined);
  const choice = signal<ChartChoice | undefined>(undefined);
  const column = signal(-1);
  let control: AbortController | undefined;

  /** Asks where the question is in the queue while it has no answer. */
  const follow = (id: string, since: number, isOver: AbortSignal): void => {
    const timer = setInterval(() => {
      void request("GET /api/query", { signal: isOver }).then((state) => {
        const own = state.ok ? state.value.questions.find((one) => one.id === id) : undefined;
        if (own && running.peek()) running.value = { since, before: own.is_running ? undefined : own.before };
      });
    }, ASK_AGAIN_MS);
    isOver.addEventListener("abort", () => clearInterval(timer));
  };

  const show = (found: QueryAnswer): void => {
    order.value = undefined;
    choice.value = firstChoice(found.columns, found.rows);
    column.value = numbersOf(found.columns)[0] ?? -1;
  };

  return {
    sql,
    store,
    prepared,
    words,
    history,
    running,
    shown,
    problem,
    failed,
    notice,
    view,
    order,
    choice,
    column,
    async load() {
      const [state, list] = await Promise.all([request("GET /api/query"), request("GET /api/query/questions")]);
      if (state.ok) store.value = state.value.store;
      if (list.ok) prepared.value = list.value;
      if (words.peek()) return;
      const found = await request("GET /api/query/tables");
      if (found.ok) words.value = found.value;
      else if (!problem.peek()) failed.value = found.problem;
    },
    async run() {
      const text = sql.peek().trim();
      if (running.peek() || text === "") return;
      const [own, over] = [new AbortController(), new AbortController()];
      control = own;
      const since = performance.now();
      const id = `${Date.now()}-${Math.round(Math.random() * 1e9)}`;
      [running.value, failed.value, notice.value] = [{ since, before: undefined }, undefined, ""];
      globalThis.history.replaceState(null, "", questionLink(text));
      follow(id, since, over.signal);
      const outcome = await request("POST /api/query", { body: { sql: text, rows: ROWS, id }, signal: own.signal });
      over.abort();
      running.value = undefined;
      if (own.signal.aborted) return;
      latest.take(text, outcome as Outcome<QueryAnswer>); // JSON was asked for
      if (outcome.ok) {
        answered = text;
        show(outcome.value as QueryAnswer);
        history.value = remembered(text, history.peek());
      }
    },
    cancel() {
      control?.abort();
    },
    async file(format) {
      const found = await respond("POST /api/query", { body: { sql: answered, format } });
      if (!(found instanceof Response)) {
        failed.value = found;
        return undefined;
      }
      try {
        return await found.blob();
      } catch {
        failed.value = UNREACHED;
        return undefined;
      }
    },
    forget() {
      history.value = [];
      writeHistory([]);
    },
  };
}

/** The address that shows a question. */
export function questionLink(text: string): string {
  return text.length > LONGEST_LINK ? href("questions") : `${href("questions")}?${new URLSearchParams({ sql: text })}`;
}

function remembered(text: string, before: readonly string[]): readonly string[] {
  const kept = [text, ...before.filter((one) => one !== text)].slice(0, MAX_QUESTIONS);
  writeHistory(kept);
  return kept;
}

function readHistory(): readonly string[] {
  try {
    const found: unknown = JSON.parse(localStorage.getItem(HISTORY) ?? "[]");
    return Array.isArray(found) ? found.filter((one): one is string => typeof one === "string") : [];
  } catch {
    return []; // storage that is blocked, or holds something else
  }
}

function writeHistory(texts: readonly string[]): void {
  try {
    localStorage.setItem(HISTORY, JSON.stringify(texts));
  } catch {
    // storage that is blocked: what was asked is kept until the page is left
  }
}
