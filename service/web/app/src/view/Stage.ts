/** Map and scan as points: from above, where the scan is dragged, or in 3-D, where one looks around. */
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  Matrix4,
  OrthographicCamera,
  PerspectiveCamera,
  Points,
  PointsMaterial,
  Raycaster,
  Scene,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { Matrix } from "../api/told";
import { matrixOf, moved, type Cloud } from "./cloud";
import { MapPoints } from "./MapPoints";
import type { MapCloud } from "./octree";
import { Outlines, type At, type Outline } from "./outlines";
import { followPointers } from "./pointers";
import { OFF_COLOUR } from "./residuals";

const LASSO_COLOUR = "#d6006c";
const LASSO_STEP_PX = 5;
const MOST_CORNERS = 400;
const MOST_POINTS = 200_000;
const PICK_PX = 5;
const STILL_PX = 4;

/** A scan that is to be placed: where it lies, and who is told when it was dragged. */
export interface ScanOnStage {
  cloud: Cloud;
  T: Matrix;
  moved: (T: Matrix) => void;
}

export interface Place {
  x: number;
  y: number;
  z: number;
}

export class Stage {
  private readonly scan: ScanOnStage | null;
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly plan = new OrthographicCamera();
  private readonly room = new PerspectiveCamera(55, 1, 0.1, 2000);
  private readonly orbit: OrbitControls;
  private readonly scanPoints: Points<BufferGeometry, PointsMaterial> | null = null;
  private readonly mapPoints: MapPoints;
  private readonly outlines = new Outlines();
  private outlined: readonly Outline[] = [];
  private lasso: ((corners: At[]) => void) | null = null;
  private drawn: At[] | null = null;
  private readonly away: (() => void)[] = [];
  private T: Matrix = matrixOf({ x: 0, y: 0, z: 0, yaw: 0 });
  private mode: "above" | "room" = "above";
  private halfHeight = 10;
  private asked = 0;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    { map, scan, picked }: { map: MapCloud; scan?: ScanOnStage; picked: (place: Place | null) => void },
  ) {
    this.scan = scan ?? null;
    const theme =
      document.documentElement.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
    const dark = theme === "dark";
    this.renderer = new WebGLRenderer({
      canvas,
      antialias: false,
      preserveDrawingBuffer: true,
      powerPreference: "high-performance",
    });
    this.scene.background = new Color(dark ? "#0d1117" : "#ffffff");
    this.mapPoints = new MapPoints(map, dark, MOST_POINTS - (scan ? scan.cloud.xyz.length / 3 : 0), () => this.draw());
    this.scene.add(this.mapPoints.group);
    if (scan) {
      const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(scan.cloud.xyz, 3));
      geometry.setAttribute("color", new BufferAttribute(new Uint8Array(scan.cloud.xyz.length), 3, true));
      this.scanPoints = new Points(
        geometry,
        new PointsMaterial({ size: 2.5, sizeAttenuation: false, vertexColors: true, depthTest: false }),
      );
      this.scanPoints.renderOrder = 1;
      this.scanPoints.matrixAutoUpdate = false;
      this.scene.add(this.scanPoints);
      this.colour(null);
    }
    this.scene.add(this.outlines.group);
    const { low, high, centre } = map.overview;
    this.plan.position.set(centre[0], centre[1], 500);
    this.plan.near = 1;
    this.plan.far = 1000;
    this.room.up.set(0, 0, 1);
    this.orbit = new OrbitControls(this.room, canvas);
    this.orbit.enabled = false;
    this.orbit.addEventListener("change", this.viewed);
    const size = Math.max(high[0] - low[0], high[1] - low[1], 4);
    this.room.position.set(centre[0] - size * 0.4, centre[1] - size * 0.8, size * 0.8);
    this.orbit.target.set(centre[0], centre[1], 0);
    this.away.push(
      followPointers(canvas, {
        grabs: (x, y) => this.grabs(x, y),
        move: (grabbed, dx, dy, zoom, turn, x, y) =>
          this.drawn ? this.drawOn(x, y) : this.move(grabbed, dx, dy, zoom, turn),
        wanted: () => this.mode === "above",
        ended: () => this.endLasso(),
      }),
    );
    const watch = new ResizeObserver(() => this.resize());
    watch.observe(canvas);
    this.away.push(() => watch.disconnect());
    this.pickOnClick(picked);
    this.fit(map.overview);
    if (scan) this.place(scan.T);
    this.resize();
  }

  place(T: Matrix): void {
    this.T = T;
    this.scanPoints?.matrix.set(...(T.flat() as Parameters<Matrix4["set"]>));
    this.draw();
  }

  /** Red, green and blue of each point of the scan; null for all the same. */
  colour(colours: Uint8Array | null): void {
    const held = this.scanPoints?.geometry.getAttribute("color") as BufferAttribute | undefined;
    if (!held) return;
    const { r, g, b } = new Color(OFF_COLOUR);
    if (colours) {
      const linear = Array.from({ length: 256 }, (_, value) =>
        Math.round(255 * new Color().setRGB(value / 255, 0, 0, "srgb").r),
      );
      for (let k = 0; k < colours.length; k++) held.array[k] = linear[colours[k]!]!;
    } else for (let k = 0; k < held.count; k++) held.setXYZ(k, r, g, b);
    held.needsUpdate = true;
    this.draw();
  }

  /** Show lines over the map, seen from above. */
  outline(outlines: readonly Outline[]): void {
    this.outlined = outlines;
    this.outlines.show(outlines);
    this.draw();
  }

  /** From now on dragging draws a region, which `taken` is told [m]; null: it moves things again. */
  drawRegions(taken: ((corners: At[]) => void) | null): void {
    this.lasso = taken;
  }

  look(mode: "above" | "room"): void {
    this.mode = mode;
    this.orbit.enabled = mode === "room";
    if (mode === "room") this.orbit.update();
    this.viewed();
  }

  readonly draw = (): void => {
    cancelAnimationFrame(this.asked);
    this.asked = requestAnimationFrame(() => {
      this.renderer.render(this.scene, this.camera);
      this.canvas.dataset.drawn = this.mode;
      this.canvas.dataset.points = String(this.mapPoints.held);
      this.canvas.dataset.settled = String(this.mapPoints.settled);
    });
  };

  leave(): void {
    cancelAnimationFrame(this.asked);
    for (const end of this.away) end();
    this.orbit.dispose();
    this.mapPoints.leave();
    this.outlines.leave();
    this.scanPoints?.geometry.dispose();
    this.scanPoints?.material.dispose();
    this.renderer.dispose();
  }

  private get camera(): OrthographicCamera | PerspectiveCamera {
    return this.mode === "above" ? this.plan : this.room;
  }

  /** The camera has another view: draw it, and see to the points that it asks for. */
  private readonly viewed = (): void => {
    this.mapPoints.look(this.camera, this.canvas.clientHeight);
    this.draw();
  };

  private pickOnClick(picked: (place: Place | null) => void): void {
    let pressed: PointerEvent | null = null;
    const down = (event: PointerEvent) => {
      pressed = event.isPrimary ? event : null;
    };
    const up = (event: PointerEvent) => {
      if (!pressed || Math.hypot(event.clientX - pressed.clientX, event.clientY - pressed.clientY) > STILL_PX) return;
      void this.pick(event.clientX, event.clientY).then(picked, () => picked(null));
    };
    this.canvas.addEventListener("pointerdown", down);
    this.canvas.addEventListener("pointerup", up);
    this.away.push(() => {
      this.canvas.removeEventListener("pointerdown", down);
      this.canvas.removeEventListener("pointerup", up);
    });
  }

  /** The map's point at a place of the window. */
  private async pick(x: number, y: number): Promise<Place | null> {
    const box = this.canvas.getBoundingClientRect();
    const caster = new Raycaster();
    caster.setFromCamera(
      new Vector2(((x - box.left) / box.width) * 2 - 1, 1 - ((y - box.top) / box.height) * 2),
      this.camera,
    );
    const pixel = (2 * Math.tan((this.room.fov * Math.PI) / 360)) / Math.max(1, this.canvas.clientHeight);
    const reach =
      this.mode === "above" ? () => PICK_PX * this.metresPerPixel() : (distance: number) => PICK_PX * pixel * distance;
    const found = await this.mapPoints.pick(caster.ray, reach);
    return found && { x: found.x, y: found.y, z: found.z };
  }

  private fit(map: Cloud): void {
    const aspect = this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
    this.halfHeight = 0.55 * Math.max(map.high[1] - map.low[1], (map.high[0] - map.low[0]) / aspect, 2);
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.room.aspect = width / height;
    this.room.updateProjectionMatrix();
    this.frame();
  }

  private frame(): void {
    const aspect = this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
    this.plan.top = this.halfHeight;
    this.plan.bottom = -this.halfHeight;
    this.plan.right = this.halfHeight * aspect;
    this.plan.left = -this.plan.right;
    this.plan.updateProjectionMatrix();
    this.plan.updateMatrixWorld();
    this.viewed();
  }

  private metresPerPixel(): number {
    return (2 * this.halfHeight) / Math.max(1, this.canvas.clientHeight);
  }

  private grabs(x: number, y: number): boolean {
    if (!this.lasso) return this.holds(x, y);
    this.drawn = [this.placeAt(x, y)];
    return false;
  }

  private drawOn(x: number, y: number): void {
    const [at, last] = [this.placeAt(x, y), this.drawn![this.drawn!.length - 1]!];
    if (Math.hypot(at[0] - last[0], at[1] - last[1]) < LASSO_STEP_PX * this.metresPerPixel()) return;
    this.drawn!.push(at);
    this.outlines.show([...this.outlined, { corners: this.drawn!, colour: LASSO_COLOUR }]);
    this.draw();
  }

  private endLasso(): void {
    const corners = this.drawn;
    this.drawn = null;
    if (!corners) return;
    const every = Math.ceil(corners.length / MOST_CORNERS);
    if (corners.length >= 3) this.lasso?.(corners.filter((_, k) => k % every === 0));
    this.outlines.show(this.outlined);
    this.draw();
  }

  /** The map's x and y [m] at a place of the window, seen from above. */
  private placeAt(x: number, y: number): At {
    const box = this.canvas.getBoundingClientRect();
    const at = new Vector3(((x - box.left) / box.width) * 2 - 1, 1 - ((y - box.top) / box.height) * 2, 0).unproject(
      this.plan,
    );
    return [at.x, at.y];
  }

  /** Whether a place of the canvas lies on the scan's own rectangle. */
  private holds(x: number, y: number): boolean {
    if (!this.scanPoints) return false;
    const { low, high } = this.scan!.cloud;
    const here = new Vector3(...this.placeAt(x, y), this.T[2]![3]).applyMatrix4(
      this.scanPoints.matrix.clone().invert(),
    );
    const margin = 12 * this.metresPerPixel();
    return [here.x, here.y].every((value, k) => value > low[k]! - margin && value < high[k]! + margin);
  }

  private move(grabbed: boolean, dx: number, dy: number, zoom: number, turn: number): void {
    const metres = this.metresPerPixel();
    if (grabbed && this.scan) {
      const by = { x: dx * metres, y: -dy * metres, yaw: -turn };
      this.place(moved(this.T, by, this.scan.cloud.centre));
      this.scan.moved(this.T);
      return;
    }
    this.plan.position.x -= dx * metres;
    this.plan.position.y += dy * metres;
    this.halfHeight = Math.min(2000, Math.max(0.5, this.halfHeight / zoom));
    this.frame();
  }
}
