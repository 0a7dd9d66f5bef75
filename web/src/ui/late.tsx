/** Components whose code is fetched when they are first shown, so that the first load of the page stays small. */
import { signal } from "@preact/signals";
import type { ComponentChild, ComponentType, FunctionComponent } from "preact";
import { useEffect } from "preact/hooks";

const RETRY_MS = 2000;

/**
 * A component that fetches its code when it is first shown, and shows `meanwhile` until it is here.
 *
 * While the server is away it asks again every two seconds, for as long as it is shown.
 */
export function late<P extends object>(
  load: () => Promise<ComponentType<P>>,
  meanwhile: ComponentChild = null,
): FunctionComponent<P> {
  const code = signal<ComponentType<P> | undefined>(undefined);
  return function Late(props: P) {
    useEffect(() => {
      let timer: ReturnType<typeof setTimeout> | undefined;
      let isShown = true;
      const ask = (): void => {
        load().then(
          (component) => {
            code.value = component;
          },
          () => {
            if (isShown) timer = setTimeout(ask, RETRY_MS);
          },
        );
      };
      if (code.peek() === undefined) ask();
      return () => {
        isShown = false;
        clearTimeout(timer);
      };
    }, []);
    const Code = code.value;
    return Code ? <Code {...props} /> : meanwhile;
  };
}
