/** A drawing's sheet in pixels: tiles of the level that the view can show, fetched as they come into sight. */
import { get, send, type Drawing } from "../api/client";
import type { SheetTold } from "../api/told";

/** What of the sheet is in sight, in pixels of the sheet, y down. */
export interface Sight {
  left: number;
  top: number;
  right: number;
  bottom: number;
  /** Pixels of the canvas for one of the sheet. */
  zoom: number;
}

const MOST_KEPT = 96;
const AT_ONCE = 4;

const nameOf = (level: number, column: number, row: number) => `${level}/${column}/${row}`;

export class SheetTiles {
  private readonly places = new Map<string, { begin: number; bytes: number }>();
  /** Least lately used first. */
  private readonly kept = new Map<string, ImageBitmap>();
  private readonly loading = new Set<string>();
  private wanted: string[] = [];
  private left = false;

  private constructor(
    private readonly told: SheetTold,
    private readonly path: string,
  ) {
    let begin = 0;
    for (const [level, column, row, bytes] of told.tiles) {
      this.places.set(nameOf(level, column, row), { begin, bytes });
      begin += bytes;
    }
  }

  /** The tiles of a drawing; null of one that is lines, or was read before tiles were kept. */
  static async open(drawing: Drawing): Promise<SheetTiles | null> {
    const { sheet, tiles } = drawing.files;
    return sheet && tiles ? new SheetTiles(await get<SheetTold>(sheet), tiles) : null;
  }

  get size(): [number, number] {
    return this.told.size_px;
  }

  /** Whether all that was in sight last is drawn. */
  get settled(): boolean {
    return this.loading.size === 0 && this.wanted.length === 0;
  }

  /** How many tiles are held. */
  get held(): number {
    return this.kept.size;
  }

  /** Draw what is in sight, coarser where the tiles are not there yet; `again` is called when they are. */
  draw(pen: CanvasRenderingContext2D, sight: Sight, again: () => void): void {
    const finest = Math.min(this.told.levels - 1, Math.max(0, Math.floor(Math.log2(1 / sight.zoom))));
    const wanted = this.inSight(sight, finest)
      .map(([column, row]) => nameOf(finest, column, row))
      .filter((name) => this.places.has(name));
    for (let level = this.told.levels - 1; level >= finest; level--) {
      for (const [column, row] of this.inSight(sight, level)) this.drawTile(pen, level, column, row);
    }
    this.wanted = wanted.filter((name) => !this.kept.has(name) && !this.loading.has(name));
    const last = nameOf(this.told.levels - 1, 0, 0);
    if (this.places.has(last) && !this.kept.has(last) && !this.loading.has(last)) this.wanted.unshift(last);
    while (this.loading.size < AT_ONCE && this.wanted.length > 0) this.loadNext(again);
  }

  leave(): void {
    this.left = true;
    for (const bitmap of this.kept.values()) bitmap.close();
    this.kept.clear();
  }

  private inSight(sight: Sight, level: number): [number, number][] {
    const edge = this.told.tile_px * 2 ** level;
    const [wide, high] = this.told.size_px;
    const found: [number, number][] = [];
    for (let row = Math.max(0, Math.floor(sight.top / edge)); row * edge < Math.min(sight.bottom, high); row++) {
      for (
        let column = Math.max(0, Math.floor(sight.left / edge));
        column * edge < Math.min(sight.right, wide);
        column++
      )
        found.push([column, row]);
    }
    return found;
  }

  private drawTile(pen: CanvasRenderingContext2D, level: number, column: number, row: number): void {
    const name = nameOf(level, column, row);
    const bitmap = this.kept.get(name);
    if (!bitmap) return;
    this.kept.delete(name);
    this.kept.set(name, bitmap);
    const [scale, edge] = [2 ** level, this.told.tile_px * 2 ** level];
    pen.drawImage(bitmap, column * edge, row * edge, bitmap.width * scale, bitmap.height * scale);
  }

  private loadNext(again: () => void): void {
    const name = this.wanted.shift();
    if (name === undefined) return;
    this.loading.add(name);
    void this.load(name)
      .then(
        (bitmap) => {
          if (this.left) {
            bitmap.close();
            return;
          }
          this.kept.set(name, bitmap);
          for (const oldest of [...this.kept.keys()].slice(0, Math.max(0, this.kept.size - MOST_KEPT))) {
            this.kept.get(oldest)!.close();
            this.kept.delete(oldest);
          }
        },
        () => undefined,
      )
      .finally(() => {
        this.loading.delete(name);
        if (this.left) return;
        this.loadNext(again);
        again();
      });
  }

  private async load(name: string): Promise<ImageBitmap> {
    const { begin, bytes } = this.places.get(name)!;
    const answer = await send("GET", this.path, {
      headers: { Range: `bytes=${begin}-${begin + bytes - 1}`, "If-Range": `"${this.told.sha256}"` },
    });
    if (answer.status !== 206) throw new Error("The drawing was read anew: load the page again.");
    return createImageBitmap(new Blob([await answer.arrayBuffer()], { type: "image/png" }));
  }
}
