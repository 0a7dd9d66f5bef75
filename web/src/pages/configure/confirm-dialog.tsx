/** Confirmation before harm: a dialog that names what is lost or cut; the safe button has the focus. */
import { useEffect, useRef } from "preact/hooks";
import { Button } from "../../ui/controls/button";
import { Dialog } from "../../ui/controls/dialog";
import { Message } from "../../ui/controls/message";
import { CAUTIONS, type Question } from "./view-state";
import { TEXT } from "../../texts/configure";

export function Ask({ asked, close }: { readonly asked: Question; readonly close: () => void }) {
  const safe = useRef<HTMLButtonElement>(null);
  useEffect(() => safe.current?.focus(), []);
  const act = (): void => {
    close();
    asked.act();
  };
  return (
    <Dialog title={asked.title} onClose={close}>
      {asked.about !== "" && <p class="question-about">{asked.about}</p>}
      {asked.caution !== "" && (
        <p class="question-subject">
          <span class="tag warn">▲ {CAUTIONS[asked.caution]}</span>
        </p>
      )}
      {asked.words.map((words) => (
        <p key={words} class="question-words">
          <Message text={words} />
        </p>
      ))}
      <div class="question-actions flex-wrap">
        <Button look="main" words={TEXT.leaveUnchanged} ref={safe} onClick={close} />
        <Button look="edge" words={asked.go} onClick={act} />
      </div>
    </Dialog>
  );
}
