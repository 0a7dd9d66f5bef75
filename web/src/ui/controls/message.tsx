/** A message or hint as the page shows it: commands in it are set as code. For panels without Preact: dom.ts. */
import { messageParts } from "../dom/message-parts";

export function Message({ text }: { readonly text: string }) {
  return <>{messageParts(text).map((part, k) => (part.isCode ? <code key={k}>{part.text}</code> : part.text))}</>;
}
