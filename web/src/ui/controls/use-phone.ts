/** Whether the window is as narrow as a phone's; follows it. */
import { useSignal } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";

export function usePhone(): boolean {
  const narrow = useMemo(() => matchMedia("(max-width: 720px)"), []);
  const isPhone = useSignal(narrow.matches);
  useEffect(() => {
    const changed = (): void => void (isPhone.value = narrow.matches);
    narrow.addEventListener("change", changed);
    return () => narrow.removeEventListener("change", changed);
  }, [isPhone, narrow]);
  return isPhone.value;
}
