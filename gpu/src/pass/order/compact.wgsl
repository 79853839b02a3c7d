// The Gaussians that are seen, in their own order. The key of their depth is made of the bits above
// NEAR's: positive floats have the order of their bits. The lowest DEPTH_SHIFT bits are left out.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments;
@group(0) @binding(1) var<storage, read> one: array<Coverage>;
@group(0) @binding(2) var<storage, read> other: array<Coverage>;
@group(0) @binding(3) var<storage, read> one_splats: array<Splat>;
@group(0) @binding(4) var<storage, read> other_splats: array<Splat>;
@group(0) @binding(5) var<storage, read> slots: array<u32>;
@group(0) @binding(6) var<storage, read_write> keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> gaussian_from_visible: array<u32>;
@group(0) @binding(8) var<storage, read_write> visible: array<Visible>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let gaussian = linear_thread(group, groups, lane);
    if gaussian > arguments.count { return; }
    let slot = slots[gaussian];
    if gaussian == arguments.count {
        visible[0] = Visible(slot, groups_for(slot + 1u));
        return;
    }
    if (one[gaussian].hits | other[gaussian].hits) == 0u { return; }
    var depth = one_splats[gaussian].form.z;
    if one[gaussian].hits == 0u { depth = other_splats[gaussian].form.z; }
    keys[slot] = (bitcast<u32>(depth) - bitcast<u32>(NEAR)) >> DEPTH_SHIFT;
    gaussian_from_visible[slot] = gaussian;
}
