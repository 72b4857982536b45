/** Strokes on a canvas that pans and zooms: a picture of them is moved while fingers move, and drawn anew at rest. */
import type { Point } from "../api/told";
import { followPointers } from "./pointers";
import type { SheetTiles } from "./SheetTiles";
import { isHidden, type Stroke } from "./sheet";

const COLOURS: Record<string, string> = {
  wall: "#141414",
  column: "#6e3c96",
  text: "#cd2850",
  dimension: "#d07800",
  hatch: "#6f9020",
  furniture: "#1f86a8",
  stair: "#a03cb0",
  door: "#1c8048",
  window: "#3060e0",
  frame: "#8a7450",
  grid: "#98784a",
  dashed: "#d0408c",
  symbol: "#e04f28",
  speck: "#88884a",
  "light-pen": "#6080a0",
  small: "#b06a6a",
  other: "#c06a30",
};
export const colourOf = (layer: string): string => COLOURS[layer] ?? COLOURS.other!;

const ROOM = 1.6;
const REST_MS = 90;
const PIXELS_SEEN = 0.5;

/** What lies over the strokes, in frame `drawing`. */
export interface Mark {
  ring: readonly Point[];
  closed: boolean;
  colour: string;
}

export interface Listener {
  tapped: (at: Point) => void;
  drawn: (ring: Point[]) => void;
}

interface View {
  /** The middle of the canvas, frame `drawing`. */
  x: number;
  y: number;
  /** Pixels of the canvas in one unit. */
  zoom: number;
}

export class SheetView {
  private readonly away: () => void;
  private readonly picture = document.createElement("canvas");
  private pictured: View = { x: 0, y: 0, zoom: 1 };
  private view: View;
  private strokes: readonly Stroke[] = [];
  private hidden: ReadonlySet<string> = new Set();
  private lit: ReadonlySet<string> = new Set();
  private marks: readonly Mark[] = [];
  private tiles: SheetTiles | null = null;
  private fitted = false;
  private freehand: Point[] | null = null;
  /** What keys have drawn so far; null while nobody draws with keys. */
  private corners: Point[] | null = null;
  private moved = 0;
  private asked = 0;
  private rest: ReturnType<typeof setTimeout> | undefined;
  private lasso = false;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly sheet: Point,
    private readonly listener: Listener,
  ) {
    this.view = { x: sheet[0] / 2, y: sheet[1] / 2, zoom: 1 };
    delete canvas.dataset.drawn;
    const leave = followPointers(canvas, {
      grabs: (x, y) => this.began(x, y),
      move: (drawing, dx, dy, zoom, _turn, x, y) =>
        drawing && zoom === 1 ? this.drew(x, y) : this.pan(dx, dy, zoom, x, y),
      wanted: () => true,
      ended: (x, y) => this.ended(x, y),
    });
    const watch = new ResizeObserver(() => this.resize());
    watch.observe(canvas);
    this.away = () => {
      leave();
      watch.disconnect();
      clearTimeout(this.rest);
      cancelAnimationFrame(this.asked);
    };
    this.fit();
  }

  leave(): void {
    this.away();
  }

  show(strokes: readonly Stroke[], hidden: ReadonlySet<string>, lit: ReadonlySet<string>): void {
    [this.strokes, this.hidden, this.lit] = [strokes, hidden, lit];
    this.redraw();
  }

  /** Show the sheet's own pixels below the strokes; null shows none. */
  under(tiles: SheetTiles | null): void {
    this.tiles = tiles;
    this.redraw();
  }

  mark(marks: readonly Mark[]): void {
    this.marks = marks;
    this.paint();
  }

  fit(): void {
    const { clientWidth: wide, clientHeight: high } = this.canvas;
    this.view = {
      x: this.sheet[0] / 2,
      y: this.sheet[1] / 2,
      zoom: 0.94 * Math.min(wide / this.sheet[0], high / this.sheet[1]) || 1,
    };
    this.redraw();
  }

  /** Pan by shares of the canvas and zoom about its middle, as keys and buttons do. */
  step(dx: number, dy: number, zoom: number): void {
    const box = this.canvas.getBoundingClientRect();
    this.pan(dx * box.width, dy * box.height, zoom, box.left + box.width / 2, box.top + box.height / 2);
  }

  /** Whether one finger draws a lasso; otherwise it pans. */
  draws(lasso: boolean): void {
    [this.lasso, this.corners] = [lasso, null];
    this.paint();
  }

  /** Draw with keys: cross-hairs in the middle say where. */
  aim(isOn: boolean): void {
    this.corners = isOn ? (this.corners ?? []) : null;
    this.paint();
  }

  /** Set a corner in the middle, as a tap there; a lasso closes with a second one at the same place. */
  press(): void {
    const at: Point = [this.view.x, this.view.y];
    const last = this.corners?.at(-1);
    if (!this.lasso) this.listener.tapped(at);
    else if (last && last[0] === at[0] && last[1] === at[1]) this.closeCorners();
    else this.corners = [...(this.corners ?? []), at];
    this.paint();
  }

  private closeCorners(): void {
    const ring = this.corners!;
    if (ring.length < 3) return;
    this.corners = [];
    this.listener.drawn(ring);
  }

  private resize(): void {
    const ratio = Math.min(devicePixelRatio, 2);
    this.canvas.width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    if (this.fitted) this.redraw();
    else this.fit();
    this.fitted ||= this.canvas.clientWidth > 0;
  }

  private at(x: number, y: number): Point {
    const box = this.canvas.getBoundingClientRect();
    return [
      this.view.x + (x - box.left - box.width / 2) / this.view.zoom,
      this.view.y - (y - box.top - box.height / 2) / this.view.zoom,
    ];
  }

  private began(x: number, y: number): boolean {
    this.moved = 0;
    this.freehand = this.lasso ? [this.at(x, y)] : null;
    return this.lasso;
  }

  private drew(x: number, y: number): void {
    this.moved += 1;
    this.freehand?.push(this.at(x, y));
    this.paint();
  }

  private pan(dx: number, dy: number, zoom: number, x: number, y: number): void {
    this.moved += Math.abs(dx) + Math.abs(dy) + (zoom === 1 ? 0 : 99);
    this.freehand = null;
    const [fixedX, fixedY] = this.at(x, y);
    const next = Math.min(1e5, Math.max(1e-5, this.view.zoom * zoom));
    const share = this.view.zoom / next;
    this.view = {
      x: fixedX + (this.view.x - fixedX) * share - dx / next,
      y: fixedY + (this.view.y - fixedY) * share + dy / next,
      zoom: next,
    };
    this.paint();
    clearTimeout(this.rest);
    this.rest = setTimeout(() => this.redraw(), REST_MS);
  }

  private ended(x: number, y: number): void {
    const ring = this.freehand;
    this.freehand = null;
    if (ring && ring.length > 2) this.listener.drawn(ring);
    else if (this.moved < 4 && !this.lasso) this.listener.tapped(this.at(x, y));
    this.paint();
  }

  /** Draw what lies in view, and some room around it, into the picture. */
  private redraw(): void {
    this.pictured = { ...this.view };
    this.picture.width = Math.ceil(this.canvas.width * ROOM);
    this.picture.height = Math.ceil(this.canvas.height * ROOM);
    const pen = this.picture.getContext("2d")!;
    const zoom = this.pictured.zoom * this.ratio();
    const [left, low] = [
      this.pictured.x - this.picture.width / 2 / zoom,
      this.pictured.y - this.picture.height / 2 / zoom,
    ];
    const [right, top] = [2 * this.pictured.x - left, 2 * this.pictured.y - low];
    pen.setTransform(zoom, 0, 0, -zoom, -left * zoom, top * zoom);
    pen.fillStyle = "#ffffff";
    pen.fillRect(left, low, right - left, top - low);
    if (this.tiles) this.drawTiles(pen, { left, low, right, top });
    const paths = new Map<string, Path2D>();
    for (const stroke of this.strokes) {
      if (
        isHidden(stroke, this.hidden) ||
        stroke.high[0] < left ||
        stroke.low[0] > right ||
        stroke.high[1] < low ||
        stroke.low[1] > top
      )
        continue;
      const key = this.lit.has(stroke.id) ? "lit" : stroke.layer;
      const path = paths.get(key) ?? new Path2D();
      paths.set(key, path);
      for (const line of stroke.lines) {
        line.forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y)));
        if (stroke.closed) path.closePath();
      }
    }
    for (const [layer, path] of paths) this.stroke(pen, layer, path, zoom);
    this.paint();
  }

  private drawTiles(
    pen: CanvasRenderingContext2D,
    { left, low, right, top }: { left: number; low: number; right: number; top: number },
  ): void {
    const units = this.sheet[0] / this.tiles!.size[0];
    const zoom = this.pictured.zoom * this.ratio() * units;
    pen.save();
    pen.transform(units, 0, 0, -units, 0, this.sheet[1]);
    pen.globalAlpha = PIXELS_SEEN;
    const sight = {
      left: left / units,
      right: right / units,
      top: (this.sheet[1] - top) / units,
      bottom: (this.sheet[1] - low) / units,
      zoom,
    };
    this.tiles!.draw(pen, sight, () => {
      clearTimeout(this.rest);
      this.rest = setTimeout(() => this.redraw(), REST_MS);
    });
    pen.restore();
  }

  private stroke(pen: CanvasRenderingContext2D, layer: string, path: Path2D, zoom: number): void {
    if (layer === "wall" || layer === "column") {
      pen.fillStyle = `${colourOf(layer)}55`;
      pen.fill(path);
    }
    pen.strokeStyle = layer === "lit" ? "#0b5cad" : colourOf(layer);
    pen.lineWidth = (layer === "lit" ? 4 : layer === "wall" ? 2 : 1.2) / zoom;
    pen.stroke(path);
  }

  private ratio(): number {
    return this.canvas.width / Math.max(1, this.canvas.clientWidth);
  }

  private readonly paint = (): void => {
    cancelAnimationFrame(this.asked);
    this.asked = requestAnimationFrame(() => {
      const pen = this.canvas.getContext("2d")!;
      const { width, height } = this.canvas;
      const zoom = this.view.zoom * this.ratio();
      const share = this.view.zoom / this.pictured.zoom;
      pen.setTransform(1, 0, 0, 1, 0, 0);
      pen.fillStyle = "#ffffff";
      pen.fillRect(0, 0, width, height);
      const [wide, high] = [this.picture.width * share, this.picture.height * share];
      pen.drawImage(
        this.picture,
        width / 2 + (this.pictured.x - this.view.x) * zoom - wide / 2,
        height / 2 - (this.pictured.y - this.view.y) * zoom - high / 2,
        wide,
        high,
      );
      pen.setTransform(zoom, 0, 0, -zoom, width / 2 - this.view.x * zoom, height / 2 + this.view.y * zoom);
      for (const mark of this.marks) this.outline(pen, mark, zoom);
      if (this.freehand) this.outline(pen, { ring: this.freehand, closed: true, colour: "#0b5cad" }, zoom);
      if (this.corners) this.crossHairs(pen, this.corners, zoom);
      this.canvas.dataset.drawn = String(this.strokes.length);
      this.canvas.dataset.tiles = this.tiles ? String(this.tiles.held) : "none";
      this.canvas.dataset.settled = String(this.tiles?.settled ?? true);
      this.canvas.dataset.view = [this.view.x, this.view.y, this.view.zoom].join(" ");
    });
  };

  private crossHairs(pen: CanvasRenderingContext2D, corners: readonly Point[], zoom: number): void {
    const { x, y } = this.view;
    const arm = 24 / zoom;
    this.outline(pen, { ring: [...corners, [x, y]], closed: false, colour: "#0b5cad" }, zoom);
    this.outline(
      pen,
      {
        ring: [
          [x - arm, y],
          [x + arm, y],
        ],
        closed: false,
        colour: "#d4006a",
      },
      zoom,
    );
    this.outline(
      pen,
      {
        ring: [
          [x, y - arm],
          [x, y + arm],
        ],
        closed: false,
        colour: "#d4006a",
      },
      zoom,
    );
  }

  private outline(pen: CanvasRenderingContext2D, { ring, closed, colour }: Mark, zoom: number): void {
    pen.beginPath();
    for (const [x, y] of ring) pen.lineTo(x, y);
    if (closed) pen.closePath();
    pen.strokeStyle = colour;
    pen.lineWidth = 3 / zoom;
    pen.stroke();
    pen.fillStyle = closed ? `${colour}33` : colour;
    if (closed) pen.fill();
    else for (const [x, y] of ring) pen.fillRect(x - 4 / zoom, y - 4 / zoom, 8 / zoom, 8 / zoom);
  }
}
