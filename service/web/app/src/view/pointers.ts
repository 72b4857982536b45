/** Mouse, pen and fingers on a plan: one drags, two pinch and turn, the wheel zooms, and turns with Shift. */
export interface Gestures {
  /** Whether what is at this place of the window is the thing to be dragged. */
  grabs: (x: number, y: number) => boolean;
  /** By how much since the last time, and where in the window it is now. */
  move: (grabbed: boolean, dx: number, dy: number, zoom: number, turn: number, x: number, y: number) => void;
  wanted: () => boolean;
  /** The last finger has left. */
  ended?: (x: number, y: number) => void;
}

interface At {
  x: number;
  y: number;
}

const between = (a: At, b: At) => ({
  x: (a.x + b.x) / 2,
  y: (a.y + b.y) / 2,
  far: Math.hypot(a.x - b.x, a.y - b.y),
  angle: Math.atan2(b.y - a.y, b.x - a.x),
});

export function followPointers(canvas: HTMLElement, gestures: Gestures): () => void {
  const held = new Map<number, At>();
  let grabbed = false;
  const down = (event: PointerEvent) => {
    if (!gestures.wanted()) return;
    canvas.setPointerCapture(event.pointerId);
    if (held.size === 0) grabbed = gestures.grabs(event.clientX, event.clientY);
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
  };
  const move = (event: PointerEvent) => {
    const before = held.get(event.pointerId);
    if (!before || !gestures.wanted()) return;
    const now = { x: event.clientX, y: event.clientY };
    const other = [...held].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const [was, is] = [between(other, before), between(other, now)];
      gestures.move(
        grabbed,
        is.x - was.x,
        is.y - was.y,
        is.far / Math.max(1, was.far),
        is.angle - was.angle,
        is.x,
        is.y,
      );
    } else gestures.move(grabbed, now.x - before.x, now.y - before.y, 1, 0, now.x, now.y);
    held.set(event.pointerId, now);
  };
  const up = (event: PointerEvent) => {
    if (held.delete(event.pointerId) && held.size === 0) gestures.ended?.(event.clientX, event.clientY);
  };
  const wheel = (event: WheelEvent) => {
    if (!gestures.wanted()) return;
    event.preventDefault();
    const amount = event.deltaY || event.deltaX;
    if (event.shiftKey) gestures.move(true, 0, 0, 1, amount * 0.0015, event.clientX, event.clientY);
    else gestures.move(false, 0, 0, Math.exp(-amount * 0.0012), 0, event.clientX, event.clientY);
  };
  canvas.addEventListener("pointerdown", down);
  canvas.addEventListener("pointermove", move);
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("wheel", wheel, { passive: false });
  return () => {
    canvas.removeEventListener("pointerdown", down);
    canvas.removeEventListener("pointermove", move);
    canvas.removeEventListener("pointerup", up);
    canvas.removeEventListener("pointercancel", up);
    canvas.removeEventListener("wheel", wheel);
  };
}
