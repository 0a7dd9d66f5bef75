/** Once more before harm: a dialog that names what is lost or cut; the button that does nothing has the focus. */
import { useEffect, useRef } from "preact/hooks";
import { Dialog } from "../../ui/dialog";
import { Message } from "../../ui/message";
import { CAUTIONS, type Question, question } from "./view-state";

export function Ask({ asked }: { readonly asked: Question }) {
  const safe = useRef<HTMLButtonElement>(null);
  useEffect(() => safe.current?.focus(), []);
  const close = (): void => {
    question.value = undefined;
  };
  const act = (): void => {
    close();
    asked.act();
  };
  return (
    <Dialog title={asked.title} onClose={close}>
      {asked.caution !== "" && (
        <p class="askwhat">
          <span class="tag warn">▲ {CAUTIONS[asked.caution]}</span>
        </p>
      )}
      {asked.words.map((words) => (
        <p key={words} class="askwords">
          <Message text={words} />
        </p>
      ))}
      <div class="askrow">
        <button type="button" class="btn main" ref={safe} onClick={close}>
          Leave it as it is
        </button>
        <button type="button" class="btn edge" onClick={act}>
          {asked.go}
        </button>
      </div>
    </Dialog>
  );
}
