// Draws the clouds: one canvas, one camera, one view beside the other.
import {
  BufferAttribute, BufferGeometry, DataTexture, DepthTexture, DoubleSide, GLSL3, Group, Matrix4, Mesh, NearestFilter,
  OrthographicCamera, PerspectiveCamera, Points, RawShaderMaterial, Scene, Vector2, Vector3, WebGLRenderer,
  WebGLRenderTarget, type IUniform, type Object3D,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { amounts, kinds } from "./colours";
import type { Arrays, Cloud, Surface, Triangles, Values } from "./data";
import depthShader from "./depth.frag.glsl";
import meshFragmentShader from "./mesh.frag.glsl";
import meshVertexShader from "./mesh.vert.glsl";
import type { Octree } from "./octree";
import passShader from "./pass.vert.glsl";
import fragmentShader from "./points.frag.glsl";
import vertexShader from "./points.vert.glsl";
import tintShader from "./tint.glsl";

const FIELD = 30; // degrees, of the camera
const SAMPLE = 20000; // points of a cloud that decide how far away the camera stands
const WIDEST = 1.5; // extent that is shown whole, as a multiple of that of nearly all points
const BEYOND = 0.1; // of the latter, what is shown beyond them of a larger one
const MARGIN = 1.03; // of the window around the clouds, as a multiple of theirs
const COVERING = 1.7; // radius of a point in spacings, at which the discs close the surface
const KEPT = 1.1; // that of a point of a result: larger discs would jut out where it bends
const APART = 0.5; // that of a point of a sparse cloud, whose discs would hide its shape if they closed the surface
const SPARSE = 10_000; // points that are shown of a cloud, at most, if it is sparse
const MOVING = 0.55; // share of these radii while the view moves, when speed counts more than pinholes
const WANTED = 45; // milliseconds for a picture while the view moves; if it takes longer, fewer points are drawn
const LONGEST = 80; // milliseconds for a picture of surfaces; if it takes longer, points are drawn while the view moves
const LEAST = 1500; // points drawn of a cloud while the view moves
const SLOW_SHARE = 0.25; // below this share the browser draws slowly, so moving pictures are coarse and without depth
const HIDDEN = 3e38; // rank of a point that is not shown, beyond all limits
const COARSE = 0.5; // pixels of a coarse picture, for each pixel of the page

/** Where and how large the clouds are drawn: `centre` goes to the origin, `size` becomes 1; `half` is from `centre` to a corner. */
export interface Frame {
  centre: [number, number, number];
  half: [number, number, number];
  size: number;
}

export interface Rectangle {
  left: number;
  top: number;
  width: number;
  height: number;
}

/** One view: a cloud in a rectangle of the page; of the rectangle only the part from `from` to `to` is drawn. */
export interface View {
  layer: Layer;
  place: Rectangle;
  from: number;
  to: number;
}

/** A cloud on the graphics card. */
export class Layer {
  readonly points: Points<BufferGeometry, RawShaderMaterial>;
  readonly shuffled: Uint32Array;
  readonly scale: Vector3;
  readonly origin: Vector3;
  readonly clip = { low: new Vector3(-Infinity, -Infinity, -Infinity), high: new Vector3(Infinity, Infinity, Infinity) };
  readonly middle = new Vector3(); // of the node of an octree, whose eight parts have
  readonly radii = new Float32Array(8).fill(1); // factors of the points' radii
  readonly unit: number; // of the positions, in steps
  mesh: Mesh<BufferGeometry, RawShaderMaterial> | null = null;
  misses = false; // whether some points are no vertices of the mesh, and are shown with it
  private vertexPoints: Uint32Array | null = null; // whose colours the vertices of the mesh have
  octree: Octree | null = null; // with deeper levels of the cloud
  numbers: Map<Values, Uint16Array> | null = null; // of the points of a node
  start = 0; // of the points of a node among those of the cloud
  private hidden: Uint8Array | null = null; // 1 for each point that is not shown

  constructor(readonly cloud: Cloud, readonly arrays: Arrays, readonly frame: Frame) {
    const n = cloud.shown;
    this.shuffled = shuffled(n);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(taken(arrays.positions, 3, this.shuffled), 3, true));
    geometry.setAttribute("octahedral", new BufferAttribute(taken(arrays.normals, 2, this.shuffled), 2, true));
    geometry.setAttribute("rank", new BufferAttribute(Float32Array.from(this.shuffled, (i) => arrays.rows[i]!), 1));
    geometry.setAttribute("spread", new BufferAttribute(taken(arrays.spreads, 1, this.shuffled), 1));
    const colours = arrays.colours ? taken(arrays.colours, 3, this.shuffled) : new Uint8Array(3 * n);
    geometry.setAttribute("colour", new BufferAttribute(colours, 3, true));
    geometry.setAttribute("amount", new BufferAttribute(new Uint16Array(n), 1));
    this.unit = arrays.positions instanceof Uint16Array ? 65535 : 1;
    [this.origin, this.scale] = boxIn(frame, cloud, this.unit);
    this.points = new Points(geometry, material(this));
    this.points.frustumCulled = false;
  }

  /** Give the layer its surface, and return that. */
  addMesh(surface: Surface, { positions, faces, points, missed }: Triangles): Mesh {
    const { colours } = this.arrays;
    const n = surface.vertices;
    this.vertexPoints = points;
    if (missed) this.joinAllBut(missed);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(positions, 3, true));
    geometry.setAttribute("colour", new BufferAttribute(colours ? taken(colours, 3, points) : new Uint8Array(3 * n), 3, true));
    geometry.setAttribute("amount", new BufferAttribute(new Uint16Array(n), 1));
    geometry.setIndex(new BufferAttribute(faces, 1));
    const [low, extent] = boxIn(this.frame, surface);
    const { scale, mode, table } = this.points.material.uniforms as Record<string, IUniform>; // the colours of the points
    const own = { low: { value: low }, extent: { value: extent }, light: { value: 1 }, ...clippedTo(this.clip) };
    const uniforms = { ...own, scale, mode, table } as Record<string, IUniform>;
    const shaders = { vertexShader: tintShader + meshVertexShader, fragmentShader: meshFragmentShader };
    this.mesh = new Mesh(geometry, new RawShaderMaterial({ glslVersion: GLSL3, side: DoubleSide, ...shaders, uniforms }));
    this.mesh.frustumCulled = false;
    return this.mesh;
  }

  /** Let the surface stand for all points but some, given their places in the arrays. */
  private joinAllBut(missed: Uint32Array): void {
    const joined = new Uint8Array(this.cloud.shown).fill(1);
    for (const index of missed) joined[index] = 0;
    this.points.geometry.setAttribute("joined", new BufferAttribute(taken(joined, 1, this.shuffled), 1));
    this.misses = true;
  }

  /** Colour the points by numbers in file order. */
  colour(mode: number, numbers: Uint16Array | null, scale: [number, number, number]): void {
    const attribute = this.points.geometry.getAttribute("amount") as BufferAttribute;
    if (numbers) (attribute.array as Uint16Array).set(taken(numbers, 1, this.shuffled));
    else (attribute.array as Uint16Array).fill(mode === 1 ? 0 : 65535);
    attribute.needsUpdate = true;
    if (this.mesh) {
      const ofMesh = this.mesh.geometry.getAttribute("amount") as BufferAttribute;
      if (numbers) (ofMesh.array as Uint16Array).set(taken(numbers, 1, this.vertexPoints!));
      else (ofMesh.array as Uint16Array).fill(mode === 1 ? 0 : 65535);
      ofMesh.needsUpdate = true;
    }
    const { uniforms } = this.points.material;
    uniforms["mode"]!.value = mode;
    (uniforms["scale"]!.value as Vector3).set(...scale);
    uniforms["table"]!.value = mode === 2 ? KINDS_TABLE : AMOUNTS_TABLE;
  }

  /** The layers that are drawn for the cloud: this one, and those of deeper nodes. */
  get parts(): Layer[] {
    return [this, ...(this.octree?.chosen ?? [])];
  }

  /** Return the layer that holds a point of the cloud, and its place in that layer's arrays. */
  part(index: number): [Layer, number] {
    return this.octree?.part(index) ?? [this, index];
  }

  /** Return where a point of the cloud is drawn. */
  place(index: number): Vector3 {
    const [layer, i] = this.part(index);
    return layer.own(i);
  }

  /** Return where a point of this layer is drawn, given its place in the arrays. */
  own(i: number): Vector3 {
    const { arrays: { positions }, unit, scale, origin } = this;
    return new Vector3(positions[3 * i]!, positions[3 * i + 1]!, positions[3 * i + 2]!)
      .divideScalar(unit).multiply(scale).add(origin);
  }

  /** Share the settings of another layer, of which this is a node. */
  share({ points, clip }: Layer): void {
    Object.assign(this.clip, clip);
    const { low, extent, radius, radii, middle } = this.points.material.uniforms as Record<string, IUniform>;
    const own = { low, extent, radius, radii, middle } as Record<string, IUniform>;
    this.points.material.uniforms = { ...points.material.uniforms, ...own };
  }

  /** Hide some points, given a 1 for each of them. */
  hide(hidden: Uint8Array | null): void {
    this.hidden = hidden;
    const ranks = this.points.geometry.getAttribute("rank") as BufferAttribute;
    ranks.array.set(Float32Array.from(this.shuffled, (i) => hidden?.[i] ? HIDDEN : this.arrays.rows[i]!));
    ranks.needsUpdate = true;
  }

  /** Return whether a point is shown, given its place in the arrays. */
  shows(index: number): boolean {
    if (this.arrays.rows[index]! >= this.limit || this.hidden?.[index]) return false;
    const { low, high } = this.clip;
    const at = this.own(index);
    for (let c = 0; c < 3; c++)
      if (at.getComponent(c) < low.getComponent(c) || at.getComponent(c) > high.getComponent(c)) return false;
    return true;
  }

  /** Whether the layer has a surface, and that is one of all points that are shown. */
  get isSolid(): boolean {
    return this.mesh !== null && this.limit >= this.cloud.points;
  }

  set limit(rows: number) {
    this.points.material.uniforms["limit"]!.value = rows;
  }

  get limit(): number {
    return this.points.material.uniforms["limit"]!.value as number;
  }
}

/** Return the lower corner and the extent of a box in a frame. */
function boxIn(frame: Frame, { low, step }: Pick<Cloud, "low" | "step">, unit = 65535): [Vector3, Vector3] {
  return [
    new Vector3(...low).sub(new Vector3(...frame.centre)).divideScalar(frame.size),
    new Vector3(...step).multiplyScalar(unit / frame.size),
  ];
}

const AMOUNTS_TABLE = table(amounts());
const KINDS_TABLE = table(kinds());

function table(colours: Uint8Array<ArrayBuffer>): DataTexture {
  const texture = new DataTexture(colours, colours.length / 4, 1);
  texture.needsUpdate = true;
  return texture;
}

function clippedTo({ low, high }: Layer["clip"]) {
  return { clipLow: { value: low }, clipHigh: { value: high } };
}

function material({ origin, scale, middle, radii, clip }: Layer): RawShaderMaterial {
  const uniforms = {
    low: { value: origin }, extent: { value: scale }, middle: { value: middle }, radii: { value: radii },
    radius: { value: 1 }, pixels: { value: 1 }, limit: { value: 1e10 }, solid: { value: false },
    light: { value: 1 }, scale: { value: new Vector3(0, 1, 1) }, mode: { value: 0 }, table: { value: AMOUNTS_TABLE },
    ...clippedTo(clip),
  };
  return new RawShaderMaterial({ glslVersion: GLSL3, vertexShader: tintShader + vertexShader, fragmentShader, uniforms });
}

/** Return 0 to n - 1 in an order whose beginnings are even samples; it is always the same. */
function shuffled(n: number): Uint32Array {
  const order = Uint32Array.from({ length: n }, (_, i) => i);
  let state = 1;
  for (let i = n - 1; i > 0; i--) {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    const j = Math.floor((state / 4294967296) * (i + 1));
    [order[i], order[j]] = [order[j]!, order[i]!];
  }
  return order;
}

function taken<A extends Uint8Array | Uint16Array | Float32Array>(array: A, columns: number, order: Uint32Array): A {
  const result = new (array.constructor as new (n: number) => A)(order.length * columns);
  for (let to = 0; to < order.length; to++)
    for (let c = 0; c < columns; c++) result[to * columns + c] = array[order[to]! * columns + c]!;
  return result;
}

export class Views {
  readonly camera = new PerspectiveCamera(FIELD, 1, 0.001, 100);
  views: View[] = [];
  size = 1; // factor of the points' radii
  shading = "both";
  meshes = false; // whether surfaces are drawn in place of points, where there are some
  private readonly renderer: WebGLRenderer;
  private readonly controls: OrbitControls;
  private readonly scene = new Scene();
  private readonly turned = new Group();
  private readonly target: WebGLRenderTarget;
  private readonly pass: Mesh<BufferGeometry, RawShaderMaterial>;
  private readonly passCamera = new OrthographicCamera();
  private share = 0.3; // of the points, drawn while the view moves
  private coarse = false;
  private slow = false; // whether the last still picture of surfaces took too long to draw them while the view moves
  private width = 0;
  private height = 0;
  private moving = false;
  private asked = false;
  private before = 0;
  private settled = 0;

  constructor(readonly canvas: HTMLCanvasElement, readonly drawn: () => void) {
    this.renderer = new WebGLRenderer({ canvas, antialias: false });
    this.renderer.autoClear = false;
    this.target = new WebGLRenderTarget(1, 1, { depthTexture: new DepthTexture(1, 1) });
    this.target.texture.minFilter = this.target.texture.magFilter = NearestFilter;
    const uniforms = {
      picture: { value: this.target.texture }, depths: { value: this.target.depthTexture },
      texel: { value: new Vector2() }, background: { value: new Vector3() }, near: { value: 0 }, far: { value: 0 },
      strength: { value: 0 },
    };
    const triangle = new BufferGeometry();
    triangle.setAttribute("position", new BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
    const shaders = { vertexShader: passShader, fragmentShader: depthShader };
    this.pass = new Mesh(triangle, new RawShaderMaterial({
      glslVersion: GLSL3, ...shaders, uniforms, depthTest: false, depthWrite: false,
    }));
    this.pass.frustumCulled = false;
    this.turned.matrixAutoUpdate = false;
    this.scene.add(this.turned);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.move());
  }

  add(drawn: Points | Mesh): void {
    this.turned.add(drawn);
  }

  remove(drawn: Points<BufferGeometry, RawShaderMaterial>): void {
    this.turned.remove(drawn);
    drawn.geometry.dispose();
    drawn.material.dispose();
  }

  /** Put the end of an axis up: x, y, z, -x, -y or -z. */
  turn(up: string): void {
    const along = "xyz".indexOf(up.at(-1)!);
    const right = along === 0 ? 1 : 0;
    const unit = (axis: number, sign = 1) => new Vector3().setComponent(axis, sign);
    const upwards = unit(along, up.startsWith("-") ? -1 : 1);
    const rows = new Matrix4().makeBasis(unit(right), upwards, unit(right).cross(upwards));
    this.turned.matrix.copy(rows.transpose());
    this.turned.matrixWorldNeedsUpdate = true;
    this.turned.updateMatrixWorld(true);
  }

  /** Return the width of the clouds, seen from a direction in degrees, divided by their height. */
  shapeFrom(azimuth: number, elevation: number): number {
    const { seen } = this.seenFrom(...axesOf(azimuth, elevation));
    const extent = (axis: number) => [1, -1].reduce((sum, sign) => sum + edge(seen.map((place) => sign * place.getComponent(axis))), 0);
    return (extent(0) || 1e-3) / (extent(1) || 1e-3);
  }

  /** Return where points of the clouds are along three axes, and their radii. */
  private seenFrom(right: Vector3, upwards: Vector3, towards: Vector3): { seen: Vector3[]; radii: number[] } {
    const [seen, radii]: [Vector3[], number[]] = [[], []];
    for (const { layer } of this.views) {
      const step = Math.max(1, Math.floor(layer.cloud.shown / SAMPLE));
      const radius = this.radius(layer);
      for (let i = 0; i < layer.cloud.shown; i += step) {
        if (!layer.shows(layer.shuffled[i]!)) continue;
        const place = layer.place(layer.shuffled[i]!).applyMatrix4(this.turned.matrix);
        seen.push(new Vector3(place.dot(right), place.dot(upwards), place.dot(towards)));
        radii.push(radius * widening(layer.arrays.spreads[layer.shuffled[i]!]!));
      }
    }
    return { seen, radii };
  }

  /** Look from a direction, in degrees, from where all of the clouds is seen. */
  look(azimuth: number, elevation: number): void {
    const [right, upwards, towards] = axesOf(azimuth, elevation);
    const { seen, radii } = this.seenFrom(right, upwards, towards);
    // A plane through the camera for each side of the picture: the camera stands as near as these leave all in between.
    const tall = Math.tan(FIELD * Math.PI / 360);
    const span = (axis: number, slope: number) => {
      const end = (sign: number) => edge(seen.map((place, i) =>
        slope * place.z + sign * place.getComponent(axis) + radii[i]! * Math.hypot(1, slope)));
      const [first, last] = [end(-1), end(1)];
      return { middle: (last - first) / 2, height: (first + last) / 2 / slope };
    };
    const [across, along] = [span(0, tall * this.aspect / MARGIN), span(1, tall / MARGIN)];
    const depth = seen.reduce((sum, place) => sum + place.z, 0) / (seen.length || 1);
    const height = Math.max(across.height, along.height, depth + 0.02);
    const looked = new Vector3()
      .addScaledVector(right, across.middle).addScaledVector(upwards, along.middle).addScaledVector(towards, depth);
    this.controls.target.copy(looked);
    this.camera.position.copy(looked).addScaledVector(towards, height - depth);
    this.controls.update();
    this.draw();
  }

  /** Turn the camera by angles in radians. */
  orbit(sideways: number, upwards: number): void {
    const arm = this.camera.position.clone().sub(this.controls.target);
    const length = arm.length();
    const azimuth = Math.atan2(arm.x, arm.z) + sideways;
    const limit = Math.PI / 2 - 0.002;
    const elevation = Math.max(-limit, Math.min(limit, Math.asin(arm.y / length) + upwards));
    arm.set(Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation), Math.cos(elevation) * Math.cos(azimuth));
    this.camera.position.copy(this.controls.target).addScaledVector(arm, length);
    this.controls.update();
  }

  /** Move the camera sideways and up, in shares of its distance. */
  shift(sideways: number, upwards: number): void {
    const distance = this.camera.position.distanceTo(this.controls.target);
    const step = new Vector3(sideways * distance, upwards * distance, 0).applyQuaternion(this.camera.quaternion);
    this.camera.position.add(step);
    this.controls.target.add(step);
    this.controls.update();
  }

  zoom(factor: number): void {
    const { target } = this.controls;
    this.camera.position.sub(target).multiplyScalar(factor).add(target);
    this.controls.update();
  }

  /** Return the canvas with a whole picture, which is there until the current task ends. */
  picture(): HTMLCanvasElement {
    this.moving = false;
    this.drawNow(performance.now());
    return this.canvas;
  }

  /** Draw as soon as the browser is ready; while the view moves, fewer points if that is too slow. */
  draw(): void {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => {
      this.asked = false;
      this.drawNow(now);
    });
  }

  /** Return the place on the page of a place in the frame of a view, and how far it lies behind the camera's plane. */
  project({ place: { left, top, width, height } }: View, framed: Vector3): Vector3 {
    const place = framed.clone().applyMatrix4(this.turned.matrix).project(this.camera);
    return new Vector3(left + (place.x + 1) / 2 * width, top + (1 - place.y) / 2 * height, place.z);
  }

  /** Return the point of a view that is seen at a place of the page, or the nearest one within reach. */
  pick(view: View, x: number, y: number, reach: number): number | null {
    const { layer, place } = view;
    const projected = new Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse)
      .multiply(this.turned.matrix);
    const [px, py] = [(x - place.left) / place.width * 2 - 1, 1 - (y - place.top) / place.height * 2];
    const seen: { index: number; off: number; away: number }[] = []; // discs under the pointer
    let [nearest, least, front] = [-1, reach, Infinity];
    for (const part of layer.parts) {
      const { arrays: { positions, spreads }, cloud, scale, origin, unit, start } = part;
      const { x: sx, y: sy, z: sz } = scale.clone().divideScalar(unit);
      const matrix = projected.clone().multiply(new Matrix4().makeTranslation(origin))
        .multiply(new Matrix4().makeScale(sx, sy, sz));
      const m = matrix.elements as number[];
      const radius = this.radius(part) * Math.min(...part.radii);
      for (let i = 0; i < cloud.shown; i++) {
        const [a, b, c] = [positions[3 * i]!, positions[3 * i + 1]!, positions[3 * i + 2]!];
        const away = m[3]! * a + m[7]! * b + m[11]! * c + m[15]!;
        if (away <= 0) continue;
        const dx = ((m[0]! * a + m[4]! * b + m[8]! * c + m[12]!) / away - px) * place.width / 2;
        const dy = ((m[1]! * a + m[5]! * b + m[9]! * c + m[13]!) / away - py) * place.height / 2;
        const off = Math.hypot(dx, dy);
        const extent = radius * widening(spreads[i]!);
        const disc = Math.max(1.5, extent * this.pixels(place.height) / away);
        if (off > Math.max(least, disc) || !part.shows(i)) continue;
        const index = start + i;
        if (off < least) [nearest, least] = [index, off];
        if (off > disc) continue;
        seen.push({ index, off, away });
        front = Math.min(front, away + 2 * extent);
      }
    }
    // The discs in front are seen, each where no other centre is nearer; beside all discs, the nearest point counts.
    const [best] = seen.filter(({ away }) => away <= front).sort((one, other) => one.off - other.off);
    const picked = best?.index ?? nearest;
    if (picked < 0) return null;
    layer.octree?.keep(picked);
    return picked;
  }

  resize(width: number, height: number): void {
    if (width < 1 || height < 1) return; // while the page is not shown
    if (width === this.width && height === this.height) return;
    [this.width, this.height] = [width, height];
    this.fit();
  }

  /** Give the picture the size of the canvas, in finer or in coarser pixels. */
  private fit(): void {
    const ratio = this.coarse ? COARSE : finest();
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(this.width, this.height, false);
    this.target.setSize(Math.floor(this.width * ratio), Math.floor(this.height * ratio));
  }

  private get aspect(): number {
    const place = this.views[0]?.place;
    return place ? place.width / place.height : 1;
  }

  private pixels(height: number): number {
    return height / 2 / Math.tan(FIELD * Math.PI / 360);
  }

  /** Return the radius of the points of a layer. */
  private radius({ cloud, frame, limit }: Layer): number {
    const visible = Math.max(1, Math.min(limit, cloud.points));
    const covering = cloud.octree || visible > SPARSE ? (cloud.role === "result" ? KEPT : COVERING) : APART;
    return covering * this.size * cloud.spacing / frame.size / Math.sqrt(visible / cloud.points);
  }

  /** Whether surfaces are drawn now. */
  private get withSurfaces(): boolean {
    return this.meshes && !(this.moving && this.slow);
  }

  private move(): void {
    this.moving = true;
    window.clearTimeout(this.settled);
    this.settled = window.setTimeout(() => this.settle(), 160);
    this.draw();
  }

  /** Draw all, unless the view moves on after the pictures that the browser still draws: on a slow machine, moves come late. */
  private settle(): void {
    const last = this.settled;
    requestAnimationFrame(() => requestAnimationFrame(() => {
      if (last !== this.settled) return;
      this.moving = false;
      this.before = 0;
      this.draw();
    }));
  }

  private drawNow(now: number): void {
    const start = performance.now();
    const { renderer, target } = this;
    this.keepPace(now);
    this.aim();
    for (const { layer, place } of this.views)
      layer.octree?.choose(this.camera, this.turned.matrix, this.pixels(place.height) * finest());
    renderer.setClearColor(0x000000, 0);
    target.scissorTest = false;
    target.viewport.set(0, 0, target.width, target.height);
    renderer.setRenderTarget(target);
    renderer.clear();
    target.scissorTest = true;
    for (const view of this.views) this.drawView(view);
    this.drawPass();
    const octrees = this.views.flatMap(({ layer }) => layer.octree ?? []);
    if ((this.meshes || octrees.length > 0) && !this.moving) {
      renderer.readRenderTargetPixels(target, 0, 0, 1, 1, new Uint8Array(4)); // waits until all is drawn
      const passed = performance.now() - start;
      this.slow = this.meshes && passed > LONGEST;
      for (const octree of octrees) octree.paced(passed);
    }
    this.drawn();
  }

  /** While the view moves, draw as many points in as fine pixels as the last pictures left time for. */
  private keepPace(now: number): void {
    if (this.moving) {
      const passed = now - this.before;
      if (this.before && !this.withSurfaces) this.share *= Math.min(1.25, Math.max(0.3, WANTED / passed));
      this.share = Math.min(1, Math.max(0.002, this.share));
      this.before = now;
    }
    const coarse = this.moving && this.share < SLOW_SHARE;
    if (coarse === this.coarse) return;
    this.coarse = coarse;
    this.fit();
  }

  private aim(): void {
    const { camera } = this;
    const distance = camera.position.distanceTo(this.controls.target);
    camera.aspect = this.aspect;
    camera.near = Math.max(distance / 1000, 1e-5);
    camera.far = distance + 50;
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
  }

  private drawView({ layer, place, from, to }: View): void {
    const { renderer, target } = this;
    const ratio = renderer.getPixelRatio();
    const solid = this.withSurfaces && layer.isSolid;
    const parts = solid && !layer.misses ? [] : layer.parts;
    const shown = new Set<Object3D>(parts.map(({ points }) => points));
    if (solid) shown.add(layer.mesh!);
    for (const other of this.turned.children) other.visible = shown.has(other);
    const bottom = target.height - (place.top + place.height) * ratio;
    const [left, width, height] = [place.left * ratio, place.width * ratio, place.height * ratio];
    target.viewport.set(left, bottom, width, height);
    target.scissor.set((place.left + from * place.width) * ratio, bottom, (to - from) * place.width * ratio, height);
    renderer.setRenderTarget(target);
    const light = this.shading === "both" || this.shading === "light" ? 1 : 0;
    for (const part of parts) {
      const { shown: all } = part.cloud;
      const count = this.moving ? Math.min(all, Math.max(LEAST / parts.length, this.share * all)) : Infinity;
      part.points.geometry.setDrawRange(0, count);
      const { uniforms } = part.points.material;
      const share = Math.min(1, count / all);
      uniforms["radius"]!.value = this.radius(part) * (this.moving ? MOVING : 1) / Math.sqrt(share);
      uniforms["pixels"]!.value = this.pixels(height);
      uniforms["light"]!.value = light;
      uniforms["solid"]!.value = solid;
    }
    if (layer.mesh) layer.mesh.material.uniforms["light"]!.value = light;
    renderer.render(this.scene, this.camera);
  }

  /** Put the picture on the canvas, shaded by depth. */
  private drawPass(): void {
    const { camera, target, pass, shading } = this;
    const { uniforms } = pass.material;
    (uniforms["texel"]!.value as Vector2).set(1 / target.width, 1 / target.height);
    const colour = getComputedStyle(this.canvas).backgroundColor.match(/[\d.]+/g)!.map(Number);
    (uniforms["background"]!.value as Vector3).set(colour[0]! / 255, colour[1]! / 255, colour[2]! / 255);
    uniforms["near"]!.value = camera.near;
    uniforms["far"]!.value = camera.far;
    uniforms["strength"]!.value = this.coarse ? 0 : shading === "both" ? 25 : shading === "depth" ? 60 : 0;
    this.renderer.setRenderTarget(null);
    this.renderer.render(pass, this.passCamera);
  }
}

/** Return the pixels of a fine picture, for each pixel of the page. */
function finest(): number {
  return Math.min(window.devicePixelRatio, 2);
}

/** Return how large a point is drawn, relative to the usual one of its cloud. */
function widening(spread: number): number {
  return 2 ** ((spread - 128) / 40);
}

/** Return the directions to the right, upwards and to the viewer who looks from a direction in degrees. */
function axesOf(azimuth: number, elevation: number): [Vector3, Vector3, Vector3] {
  const [a, e] = [azimuth * Math.PI / 180, Math.max(-89.9, Math.min(89.9, elevation)) * Math.PI / 180];
  const towards = new Vector3(Math.cos(e) * Math.sin(a), Math.sin(e), Math.cos(e) * Math.cos(a));
  const right = new Vector3(Math.cos(a), 0, -Math.sin(a));
  return [right, new Vector3().crossVectors(towards, right), towards];
}

/** Return the largest of some numbers; if a few lie far from nearly all others, the largest of these, and a little more. */
function edge(numbers: number[]): number {
  const sorted = Float64Array.from(numbers).sort();
  const at = (share: number) => sorted[Math.round(share * (sorted.length - 1))] ?? 0;
  const [low, high] = [at(0.01), at(0.99)];
  return at(1) - low <= WIDEST * (high - low) ? at(1) : high + BEYOND * (high - low);
}
