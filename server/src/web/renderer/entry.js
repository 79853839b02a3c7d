// What the 3D view uses of three.js and Spark.
export {
  BufferGeometry, Color, Group, Matrix4, PerspectiveCamera, Quaternion, Scene, Vector3, WebGLRenderer,
} from 'three';
export { LineMaterial } from 'three/addons/lines/LineMaterial.js';
export { LineSegments2 } from 'three/addons/lines/LineSegments2.js';
export { LineSegmentsGeometry } from 'three/addons/lines/LineSegmentsGeometry.js';
export { PackedSplats, SparkRenderer, SplatMesh, setPackedSplat } from '@sparkjsdev/spark';
