/** The page's words. Every file of this folder but this one is a language, named by its code. */
import en, { type Words } from "./en";

const others = import.meta.glob<{ default: Words }>(["./*.ts", "!./index.ts", "!./en.ts"]);
const codeOf = (path: string) => path.replace("./", "").replace(".ts", "");
export const languages: readonly string[] = ["en", ...Object.keys(others).map(codeOf)];

let words: Words = en;
export let language = "en";

function wanted(): string {
  const asked = [localStorage.getItem("language"), ...navigator.languages.map((tag) => tag.split("-")[0])];
  return asked.find((code): code is string => !!code && languages.includes(code)) ?? "en";
}

/** Load the words of the language that the user chose, or whose browser asks for it. */
export async function loadWords(): Promise<void> {
  language = wanted();
  words = language === "en" ? en : (await others[`./${language}.ts`]!()).default;
  document.documentElement.lang = language;
}

export async function choose(code: string): Promise<void> {
  localStorage.setItem("language", code);
  await loadWords();
}

export const t = (key: keyof Words): string => words[key];

/** Words for a value that the service names, such as a state; one that a newer service may add names itself. */
export const named = <G extends string, V extends string>(
  group: G,
  value: `${G}.${V}` extends keyof Words ? V : never,
): string => (words as Record<string, string>)[`${group}.${value}`] ?? value;

export const whenText = (iso: string): string =>
  new Intl.DateTimeFormat(language, { dateStyle: "medium", timeStyle: "short" }).format(new Date(iso));

export function bytesText(bytes: number): string {
  const units = ["byte", "kilobyte", "megabyte", "gigabyte", "terabyte"] as const;
  const step = Math.min(units.length - 1, Math.max(0, Math.floor(Math.log10(Math.max(1, bytes)) / 3)));
  const style = { style: "unit", unit: units[step], maximumFractionDigits: step > 2 ? 1 : 0 } as const;
  return new Intl.NumberFormat(language, style).format(bytes / 1000 ** step);
}
