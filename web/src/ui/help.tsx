/** The `?` overlay: every key, printed from the table that the page listens by. */
import { Dialog } from "./dialog";
import { KEY_LINES } from "./keys";

export function Help({ onClose }: { readonly onClose: () => void }) {
  return (
    <Dialog title="Keys" onClose={onClose}>
      <dl class="keys">
        {KEY_LINES.map((line) => (
          <>
            <dt>
              {line.keys.map((key) => (
                <kbd>{key}</kbd>
              ))}
            </dt>
            <dd>{line.what}</dd>
          </>
        ))}
      </dl>
      <p class="hint" style={{ marginTop: "16px" }}>
        On the plots: wheel zooms about the pointer, drag pans, Shift-drag selects a range, double click fits. A click pins the cursor, Shift-click
        pins a second one and measures between them. With fingers: drag pans, two fingers zoom, a tap pins, and a finger that rests half a
        second pins the second cursor.
      </p>
    </Dialog>
  );
}
