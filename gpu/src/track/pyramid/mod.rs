//! An RGB-D image as a pyramid of levels on the device, for [`crate::track::align`].
//!
//! In: a camera's frame (8 bit RGB, depth in metres) or a rendered view (rows r, g, b, D and pixel
//! states). Out: per level [`Level::colors`], height x width of (intensity, dI/du, dI/dv), and
//! [`Level::surface`], height x width of (depth, unit normal to the camera), all in the level's own
//! camera frame, packed as `packed.wgsl` says. Intensity is in [0, 1] or -1 for none; depth in
//! metres or 0 for none; there is no normal where a neighbour's depth is missing or more than
//! [`DEPTH_AGREEMENT`] away, and where depth bends by more than [`DEPTH_BEND`]; slopes are per
//! pixel.
//!
//! A coarser level halves the finer one: a pixel covers 2x2 of it, and an odd last column or row is
//! left out, so that pixel areas keep their place as [`Camera::resized`] has it. A pyramid is
//! allocated once and filled for each frame of its size; filling does not read back.
//!
//! [`DEPTH_AGREEMENT`]: crate::shader::layout::DEPTH_AGREEMENT
//! [`DEPTH_BEND`]: crate::shader::layout::DEPTH_BEND

use crate::device::{Buffer, Gpu, GpuError, expect_len};
use crate::pass::Camera;
use crate::shader::layout::{PixelState, PyramidArguments, Row};
use crate::shader::{Access, GRID, Kernel, Recorder, Shader};

/// How a pixel is packed.
pub(super) const PACKED: &str = include_str!("packed.wgsl");
/// Smallest width and height of a level, in pixels.
const SMALLEST: u32 = 4;

/// The kernels that fill pyramids.
pub struct Pyramids {
    gpu: Gpu,
    unpack: Kernel,
    rendered: Kernel,
    halve: Kernel,
    finish: Kernel,
}

/// One image at several sizes, finest first.
pub struct Pyramid {
    levels: Vec<Level>,
    /// Three bytes a pixel, r, g, b.
    rgb8: Buffer<[u8; 4]>,
    depth_metres: Buffer<f32>,
}

/// One image at one size.
pub struct Level {
    /// Size and intrinsics of this level; the pose is not used.
    pub camera: Camera,
    /// Height x width of intensity or -1, and dI/du and dI/dv in 16 bits each.
    pub colors: Buffer<[u32; 2]>,
    /// Height x width of depth in metres or 0, and the normal in 16 bits for each axis of an
    /// octahedron, or [`NO_NORMAL`](crate::shader::layout::NO_NORMAL).
    pub surface: Buffer<[u32; 2]>,
    bases: Buffer<[f32; 2]>,
}

/// This kernel's shaders.
pub fn shaders() -> [Shader; 4] {
    use Access::{Read, Write};
    let shader = |label, text, bindings| Shader {
        label,
        entry: "main",
        parts: vec![GRID, include_str!("intensity.wgsl"), PACKED, text],
        constants: Vec::new(),
        bindings,
    };
    [
        shader("pyramid_unpack", include_str!("unpack.wgsl"), vec![Read, Read, Write]),
        shader("pyramid_rendered", include_str!("rendered.wgsl"), vec![Read, Read, Write]),
        shader("pyramid_halve", include_str!("halve.wgsl"), vec![Read, Write]),
        shader("pyramid_finish", include_str!("finish.wgsl"), vec![Read, Write, Write]),
    ]
}

impl Pyramids {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [unpack, rendered, halve, finish] = shaders();
        Ok(Self {
            gpu: gpu.clone(),
            unpack: Kernel::new(gpu, &unpack)?,
            rendered: Kernel::new(gpu, &rendered)?,
            halve: Kernel::new(gpu, &halve)?,
            finish: Kernel::new(gpu, &finish)?,
        })
    }

    /// Room for images of `camera` at `levels` sizes; empty until filled.
    ///
    /// # Errors
    /// [`GpuError::BadValue`] for no level, one below 4 pixels or an unusable camera,
    /// [`GpuError::OutOfMemory`].
    pub fn allocate(&self, camera: &Camera, levels: usize) -> Result<Pyramid, GpuError> {
        let cameras = cameras(camera, levels)?;
        let level = |camera: Camera| {
            Ok(Level {
                colors: Buffer::new(&self.gpu, "level colors", camera.pixels())?,
                surface: Buffer::new(&self.gpu, "level surface", camera.pixels())?,
                bases: Buffer::new(&self.gpu, "level bases", camera.pixels())?,
                camera,
            })
        };
        Ok(Pyramid {
            levels: cameras.into_iter().map(level).collect::<Result<_, GpuError>>()?,
            rgb8: Buffer::new(&self.gpu, "frame color", (3 * camera.pixels()).div_ceil(4))?,
            depth_metres: Buffer::new(&self.gpu, "frame depth", camera.pixels())?,
        })
    }

    /// Fills a pyramid from a camera's frame: `rgb8` is height x width x 3, `depth_metres` height x
    /// width; a depth that is not a positive number is no measurement.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`], [`GpuError::OutOfMemory`].
    pub fn fill(
        &self,
        pyramid: &mut Pyramid,
        rgb8: &[u8],
        depth_metres: &[f32],
    ) -> Result<(), GpuError> {
        let pixels = pyramid.levels[0].camera.pixels();
        expect_len("rgb8", 3 * pixels, rgb8.len())?;
        expect_len("depth_metres", pixels, depth_metres.len())?;
        let (words, rest) = rgb8.as_chunks::<4>();
        pyramid.rgb8.write(&self.gpu, 0, words);
        if !rest.is_empty() {
            let mut word = [0; 4];
            word[..rest.len()].copy_from_slice(rest);
            pyramid.rgb8.write(&self.gpu, words.len(), &[word]);
        }
        pyramid.depth_metres.write(&self.gpu, 0, depth_metres);
        let mut recorder = Recorder::new(&self.gpu)?;
        let level = &pyramid.levels[0];
        let buffers: [&wgpu::Buffer; 3] = [&pyramid.rgb8, &pyramid.depth_metres, &level.bases];
        recorder.dispatch_threads(&self.unpack, &arguments(level, 0), &buffers, pixels);
        self.finish(&mut recorder, pyramid);
        recorder.submit();
        Ok(())
    }

    /// Records the filling of a pyramid from a rendered view of its size: `image` is height x width
    /// of (r, g, b, D = sum of z alpha T), `pixels` the transmittance of each. Pixels
    /// with an opacity of at most one half have neither intensity nor depth.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] when the buffers hold fewer pixels than the view.
    pub fn fill_rendered(
        &self,
        recorder: &mut Recorder<'_>,
        pyramid: &Pyramid,
        image: &Buffer<Row>,
        pixels: &Buffer<PixelState>,
    ) -> Result<(), GpuError> {
        let level = &pyramid.levels[0];
        let count = level.camera.pixels();
        expect_len("image", count, image.len().min(count))?;
        expect_len("pixels", count, pixels.len().min(count))?;
        let buffers: [&wgpu::Buffer; 3] = [image, pixels, &level.bases];
        recorder.dispatch_threads(&self.rendered, &arguments(level, 0), &buffers, count);
        self.finish(recorder, pyramid);
        Ok(())
    }

    /// Records everything after the finest level's (intensity, depth).
    fn finish(&self, recorder: &mut Recorder<'_>, pyramid: &Pyramid) {
        for pair in pyramid.levels.windows(2) {
            let [fine, coarse] = pair else { continue };
            let buffers: [&wgpu::Buffer; 2] = [&fine.bases, &coarse.bases];
            let arguments = arguments(coarse, fine.camera.width);
            recorder.dispatch_threads(&self.halve, &arguments, &buffers, coarse.camera.pixels());
        }
        for level in &pyramid.levels {
            let buffers: [&wgpu::Buffer; 3] = [&level.bases, &level.colors, &level.surface];
            let pixels = level.camera.pixels();
            recorder.dispatch_threads(&self.finish, &arguments(level, 0), &buffers, pixels);
        }
    }
}

impl Pyramid {
    /// The levels, finest first; at least one.
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        let level = |level: &Level| level.colors.size() + level.surface.size() + level.bases.size();
        self.rgb8.size() + self.depth_metres.size() + self.levels.iter().map(level).sum::<u64>()
    }
}

/// The camera of each level, finest first. An odd last column or row is left out before halving.
///
/// # Errors
/// [`GpuError::BadValue`] for no level, one below 4 pixels or an unusable camera.
pub fn cameras(camera: &Camera, levels: usize) -> Result<Vec<Camera>, GpuError> {
    let numbers = [camera.fx, camera.fy, camera.cx, camera.cy];
    if !(numbers.iter().all(|v| v.is_finite()) && camera.fx > 0.0 && camera.fy > 0.0) {
        let (what, expected) = ("camera", "finite intrinsics, focal lengths above 0");
        return Err(GpuError::BadValue { what, expected, found: format!("{numbers:?}") });
    }
    let smaller = |camera: &Camera| {
        let (width, height) = (camera.width / 2, camera.height / 2);
        Some(Camera { width: 2 * width, height: 2 * height, ..*camera }.resized(width, height))
    };
    let cameras: Vec<_> =
        std::iter::successors(Some(camera.clone()), smaller).take(levels.min(32)).collect();
    match cameras.last() {
        Some(last) if last.width.min(last.height) >= SMALLEST => Ok(cameras),
        _ => Err(GpuError::BadValue {
            what: "levels",
            expected: "at least one, none below 4 pixels",
            found: format!("{levels} of {}x{}", camera.width, camera.height),
        }),
    }
}

fn arguments(level: &Level, fine_width: u32) -> PyramidArguments {
    let camera = &level.camera;
    PyramidArguments {
        focal: [camera.fx, camera.fy],
        centre: [camera.cx, camera.cy],
        size: [camera.width, camera.height],
        fine_width,
        unused: 0,
    }
}
