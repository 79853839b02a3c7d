//! A device that is lost in the middle of the work.

use nalgebra::Isometry3;

use crate::device::{Buffer, Gpu, GpuError};
use crate::map::{Gaussians, HostGaussians, HostHead};
use crate::pass::camera::Camera;
use crate::pass::render::Renderer;

#[test]
fn a_lost_device_is_an_error_and_no_panic() {
    let gpu = Gpu::new(None).expect("these tests need a vulkan adapter");
    let mut renderer = Renderer::new(&gpu, 1).expect("compiles");
    let mut map = Gaussians::new(&gpu, 1);
    let head = |channels| HostHead {
        rotations: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scales: vec![[0.0; 3]],
        opacity_logits: vec![0.0],
        features: vec![1.0; channels],
        channels,
    };
    let one = HostGaussians { means: vec![[0.0, 0.0, 2.0]], color: head(3), language: head(1) };
    map.append(&one).expect("fits");
    let camera = Camera {
        width: 8,
        height: 8,
        fx: 8.0,
        fy: 8.0,
        cx: 3.5,
        cy: 3.5,
        camera_from_world: Isometry3::identity(),
    };
    renderer.render_color(&map, &camera).expect("the device is there");
    gpu.device().destroy();
    let lost = |error: GpuError| matches!(error, GpuError::DeviceLost(_));
    assert!(lost(renderer.render_color(&map, &camera).expect_err("it is gone")));
    assert!(lost(map.to_host().expect_err("it is gone")));
    assert!(lost(map.append(&one).expect_err("it is gone")));
    assert!(lost(Buffer::<u32>::new(&gpu, "late", 8).err().expect("it is gone")));
}
