//! Every shader is parsed and validated by naga, and every struct of the layout is compared with
//! what naga makes of the WGSL header. Needs no device.

use lexsplat_gpu::primitives::sort::SortShape;
use lexsplat_gpu::shader::layout::{self, STRUCTS};
use lexsplat_gpu::shader::{Access, Shader, Tiling};
use lexsplat_gpu::{map, pass, primitives, track, train};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// Every shader of this package but the self-test's, for a language head of `channels` channels.
fn catalogue(channels: usize, tiling: Tiling, shape: SortShape) -> Vec<Shader> {
    let mut shaders = Vec::new();
    shaders.extend(primitives::scan::shaders());
    shaders.extend(primitives::sort::shaders(shape));
    shaders.extend(primitives::reduce::shaders());
    shaders.extend(primitives::gather::shaders());
    shaders.extend(map::prune::shaders());
    shaders.extend(map::morton::shaders());
    shaders.extend(pass::order::shaders());
    shaders.extend(pass::tiles::shaders(tiling, shape));
    for (rows, color) in [(1, true), (layout::rows_for(channels), false)] {
        shaders.extend(pass::project::shaders(tiling, rows, color));
        shaders.extend(pass::blend::shaders(tiling, rows, color));
    }
    shaders.extend(train::loss::shaders(tiling));
    shaders.extend(train::focus::shaders(tiling));
    shaders.extend(train::adam::shaders());
    shaders.extend(train::ties::shaders());
    shaders.extend(track::pyramid::shaders());
    shaders.extend(track::align::shaders());
    shaders
}

fn parse(text: &str) -> naga::Module {
    naga::front::wgsl::parse_str(text)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(text)))
}

/// Every way in which tiles are spread over threads, and what it needs beyond the baseline.
fn tilings() -> impl Iterator<Item = (Tiling, Capabilities)> {
    let subgroups = [4, 8, 16, 32, 64].into_iter().filter_map(Tiling::subgroup);
    subgroups
        .map(|tiling| (tiling, Capabilities::SUBGROUP))
        .chain([(Tiling::PORTABLE, Capabilities::empty())])
}

fn validate(
    module: &naga::Module,
    text: &str,
    capabilities: Capabilities,
) -> naga::valid::ModuleInfo {
    Validator::new(ValidationFlags::all(), capabilities)
        .validate(module)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(text)))
}

#[test]
fn every_shader_is_valid_on_its_baseline() {
    for (tiling, capabilities) in tilings() {
        for channels in [1, 3, 15, 16, 20, 64] {
            check(&catalogue(channels, tiling, SortShape::FEW_THREADS), capabilities);
        }
    }
}

fn check(shaders: &[Shader], capabilities: Capabilities) {
    for shader in shaders {
        let text = shader.compose();
        let module = parse(&text);
        let info = validate(&module, &text, capabilities);
        let entry = module.entry_points.iter().position(|point| point.name == shader.entry);
        let entry = entry.unwrap_or_else(|| panic!("{} has no {}", shader.label, shader.entry));
        assert!(shader.bindings.len() <= 8, "{}: too many storage buffers", shader.label);
        let used = info.get_entry_point(entry);
        for (handle, global) in module.global_variables.iter() {
            let Some(binding) = &global.binding else { continue };
            let slot = binding.binding as usize;
            assert_eq!(binding.group, 0, "{}: one group", shader.label);
            let naga::AddressSpace::Storage { access } = global.space else {
                assert_eq!(slot, 0, "{}: the uniform is binding 0", shader.label);
                continue;
            };
            let writes = access.contains(naga::StorageAccess::STORE);
            let declared = shader.bindings.get(slot - 1);
            assert_eq!(
                declared,
                Some(&if writes { Access::Write } else { Access::Read }),
                "{}: binding {slot}",
                shader.label
            );
            assert!(!used[handle].is_empty(), "{}: binding {slot} unused", shader.label);
        }
    }
}

#[test]
fn a_backward_batch_fits_the_guaranteed_workgroup_memory() {
    for shader in catalogue(16, Tiling::PORTABLE, SortShape::MANY_THREADS) {
        let module = parse(&shader.compose());
        let bytes: u32 = module
            .global_variables
            .iter()
            .filter(|(_, global)| global.space == naga::AddressSpace::WorkGroup)
            .map(|(_, global)| module.types[global.ty].inner.size(module.to_ctx()))
            .sum();
        assert!(bytes <= 16 << 10, "{}: {bytes} bytes", shader.label);
    }
}

#[test]
fn structs_have_the_same_layout_in_rust_and_wgsl() {
    let header = layout::wgsl_header();
    let module = parse(&header);
    for wanted in STRUCTS {
        compare(&module, wanted).unwrap_or_else(|problem| panic!("{}: {problem}", wanted.name));
    }
}

#[test]
fn a_moved_field_is_noticed() {
    let header = layout::wgsl_header().replace("extent: vec2<f32>,", "extent: vec4<f32>,");
    let module = parse(&header);
    let splat = STRUCTS.iter().find(|s| s.name == "Splat").expect("there is a Splat");
    assert!(compare(&module, splat).is_err());
    let header = layout::wgsl_header().replace("extent: vec2", "extents: vec2");
    assert!(compare(&parse(&header), splat).is_err());
}

fn compare(module: &naga::Module, wanted: &layout::Struct) -> Result<(), String> {
    let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(wanted.name));
    let naga::TypeInner::Struct { members, span } = &found.ok_or("missing in wgsl")?.1.inner else {
        return Err("not a struct".to_owned());
    };
    if *span as usize != wanted.size {
        return Err(format!("size {span}, in rust {}", wanted.size));
    }
    if members.len() != wanted.fields.len() {
        return Err(format!("{} fields, in rust {}", members.len(), wanted.fields.len()));
    }
    for (member, field) in members.iter().zip(wanted.fields) {
        if member.name.as_deref() != Some(field.name) || member.offset as usize != field.offset {
            return Err(format!(
                "{:?} at {}, in rust {} at {}",
                member.name, member.offset, field.name, field.offset
            ));
        }
    }
    Ok(())
}
