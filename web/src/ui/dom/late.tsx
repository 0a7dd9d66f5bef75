/** Components whose code is fetched when they are first shown, so that the first load of the page stays small. */
import { signal } from "@preact/signals";
import type { ComponentChild, ComponentType, FunctionComponent } from "preact";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { holdTyping } from "./typed-ahead";

const RETRY_MS = 2000;

/** Fetch code, again every two seconds while the server is away, until the returned function is called. */
export function fetchCode<T>(load: () => Promise<T>, take: (code: T) => void): () => void {
  let timer: ReturnType<typeof setTimeout> | undefined;
  let isWanted = true;
  const again = (): void => {
    if (isWanted) timer = setTimeout(ask, RETRY_MS);
  };
  const ask = (): void => void load().then((code) => isWanted && take(code), again);
  ask();
  return () => {
    isWanted = false;
    clearTimeout(timer);
  };
}

/**
 * A component that fetches its code when it is first shown, and shows `meanwhile` until it is here.
 *
 * While the server is away it asks again every two seconds, for as long as it is shown.
 *
 * @param hasField keys typed meanwhile are for the field that it begins with
 */
export function late<P extends object>(
  load: () => Promise<ComponentType<P>>,
  meanwhile: ComponentChild = null,
  hasField = false,
): FunctionComponent<P> {
  const code = signal<ComponentType<P> | undefined>(undefined);
  return function Late(props: P) {
    useEffect(() => (code.peek() ? undefined : fetchCode(load, (component) => (code.value = component))), []);
    const Code = code.value;
    const release = useRef<(() => void) | undefined>(undefined);
    useLayoutEffect(() => {
      if (hasField && !Code) release.current = holdTyping();
      return () => release.current?.();
    }, []);
    // its field takes the focus in an effect, too
    useEffect(() => void (Code && setTimeout(() => release.current?.())), [Code]);
    return Code ? <Code {...props} /> : meanwhile;
  };
}
