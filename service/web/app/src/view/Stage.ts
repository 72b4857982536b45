/** Map and scan as points: from above, where the scan is dragged, or in 3-D, where one looks around. */
import {
  BufferAttribute, BufferGeometry, Color, Matrix4, OrthographicCamera, PerspectiveCamera, Points, PointsMaterial, Scene, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { moved, type Cloud, type Matrix } from "./cloud";
import { followPointers } from "./pointers";

const SCAN_COLOUR = "#ff6a13";
const CUT_ABOVE_M = 0.3;

function geometryOf(cloud: Cloud): BufferGeometry {
  return new BufferGeometry().setAttribute("position", new BufferAttribute(cloud.xyz, 3));
}

/** Blue below to pale above, so that walls read as walls. */
function colourByHeight(geometry: BufferGeometry, cloud: Cloud, dark: boolean): void {
  const [floor, top] = dark ? [new Color("#3b6ea5"), new Color("#c9def5")] : [new Color("#a9c3df"), new Color("#0b3763")];
  const colours = new Float32Array(cloud.xyz.length);
  const span = Math.max(0.1, cloud.high[2] - cloud.low[2]);
  const mixed = new Color();
  for (let k = 0; k < cloud.xyz.length; k += 3) {
    mixed.lerpColors(floor, top, Math.min(1, (cloud.xyz[k + 2]! - cloud.low[2]) / span + (cloud.xyz[k + 2]! > cloud.low[2] + CUT_ABOVE_M ? 0.25 : 0))).toArray(colours, k);
  }
  geometry.setAttribute("color", new BufferAttribute(colours, 3));
}

export class Stage {
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly plan = new OrthographicCamera();
  private readonly room = new PerspectiveCamera(55, 1, 0.1, 2000);
  private readonly orbit: OrbitControls;
  private readonly scanPoints: Points<BufferGeometry, PointsMaterial>;
  private readonly mapPoints: Points<BufferGeometry, PointsMaterial>;
  private readonly away: (() => void)[] = [];
  private T: Matrix;
  private mode: "above" | "room" = "above";
  private halfHeight = 10;
  private asked = 0;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    map: Cloud,
    private readonly scan: Cloud,
    T: Matrix,
    private readonly changed: (T: Matrix) => void,
  ) {
    this.T = T;
    const theme = document.documentElement.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
    const dark = theme === "dark";
    this.renderer = new WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true, powerPreference: "high-performance" });
    this.scene.background = new Color(dark ? "#0d1117" : "#ffffff");
    const mapGeometry = geometryOf(map);
    colourByHeight(mapGeometry, map, dark);
    this.mapPoints = new Points(mapGeometry, new PointsMaterial({ size: 2, sizeAttenuation: false, vertexColors: true }));
    this.scanPoints = new Points(geometryOf(scan), new PointsMaterial({ size: 2.5, sizeAttenuation: false, color: SCAN_COLOUR, depthTest: false }));
    this.scanPoints.renderOrder = 1;
    this.scanPoints.matrixAutoUpdate = false;
    this.scene.add(this.mapPoints, this.scanPoints);
    this.plan.position.set(map.centre[0], map.centre[1], 500);
    this.plan.near = 1;
    this.plan.far = 1000;
    this.room.up.set(0, 0, 1);
    this.orbit = new OrbitControls(this.room, canvas);
    this.orbit.enabled = false;
    this.orbit.addEventListener("change", this.draw);
    const size = Math.max(map.high[0] - map.low[0], map.high[1] - map.low[1], 4);
    this.room.position.set(map.centre[0] - size * 0.4, map.centre[1] - size * 0.8, size * 0.8);
    this.orbit.target.set(map.centre[0], map.centre[1], 0);
    this.away.push(followPointers(canvas, {
      grabs: (x, y) => this.holds(x, y),
      move: (grabbed, dx, dy, zoom, turn) => this.move(grabbed, dx, dy, zoom, turn),
      wanted: () => this.mode === "above",
    }));
    const watch = new ResizeObserver(() => this.resize());
    watch.observe(canvas);
    this.away.push(() => watch.disconnect());
    this.fit(map);
    this.place(T);
    this.resize();
  }

  place(T: Matrix): void {
    this.T = T;
    this.scanPoints.matrix.set(...(T.flat() as Parameters<Matrix4["set"]>));
    this.draw();
  }

  look(mode: "above" | "room"): void {
    this.mode = mode;
    this.orbit.enabled = mode === "room";
    if (mode === "room") this.orbit.update();
    this.draw();
  }

  readonly draw = (): void => {
    cancelAnimationFrame(this.asked);
    this.asked = requestAnimationFrame(() => {
      this.renderer.render(this.scene, this.mode === "above" ? this.plan : this.room);
      this.canvas.dataset.drawn = this.mode;
      this.canvas.dataset.points = String(this.mapPoints.geometry.getAttribute("position").count);
    });
  };

  leave(): void {
    cancelAnimationFrame(this.asked);
    for (const end of this.away) end();
    this.orbit.dispose();
    for (const points of [this.mapPoints, this.scanPoints]) {
      points.geometry.dispose();
      points.material.dispose();
    }
    this.renderer.dispose();
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
    this.draw();
  }

  private metresPerPixel(): number {
    return (2 * this.halfHeight) / Math.max(1, this.canvas.clientHeight);
  }

  /** Whether a place of the canvas lies on the scan's own rectangle. */
  private holds(x: number, y: number): boolean {
    const box = this.canvas.getBoundingClientRect();
    const at = new Vector3(((x - box.left) / box.width) * 2 - 1, 1 - ((y - box.top) / box.height) * 2, 0).unproject(this.plan);
    const here = at.setZ(this.T[2]![3]!).applyMatrix4(this.scanPoints.matrix.clone().invert());
    const margin = 12 * this.metresPerPixel();
    return [here.x, here.y].every((value, k) => value > this.scan.low[k]! - margin && value < this.scan.high[k]! + margin);
  }

  private move(grabbed: boolean, dx: number, dy: number, zoom: number, turn: number): void {
    const metres = this.metresPerPixel();
    if (grabbed) {
      const by = { x: dx * metres, y: -dy * metres, yaw: -turn };
      this.place(moved(this.T, by, this.scan.centre));
      this.changed(this.T);
      return;
    }
    this.plan.position.x -= dx * metres;
    this.plan.position.y += dy * metres;
    this.halfHeight = Math.min(2000, Math.max(0.5, this.halfHeight / zoom));
    this.frame();
  }
}
