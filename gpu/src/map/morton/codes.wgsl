// key = bits of the cells (x, y, z) interleaved, x lowest; cell = floor((p - low) scale), at most
// 1023. A point that is not finite gets the last key. The payload is the Gaussian.

@group(0) @binding(0) var<uniform> arguments: MortonArguments;
@group(0) @binding(1) var<storage, read> means: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> gaussian_from_rank: array<u32>;

/// Ten bits, two zeros behind each.
fn spread(cells: vec3<u32>) -> vec3<u32> {
    var x = cells;
    x = (x | (x << vec3<u32>(16u))) & vec3<u32>(0x030000ffu);
    x = (x | (x << vec3<u32>(8u))) & vec3<u32>(0x0300f00fu);
    x = (x | (x << vec3<u32>(4u))) & vec3<u32>(0x030c30c3u);
    return (x | (x << vec3<u32>(2u))) & vec3<u32>(0x09249249u);
}

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let gaussian = linear_thread(group, groups, lane);
    if gaussian >= arguments.count { return; }
    let p = means[gaussian].xyz;
    var key = MORTON_LAST;
    if is_finite(p.x) && is_finite(p.y) && is_finite(p.z) {
        let cells = vec3<u32>((p - arguments.low.xyz) * arguments.scale.xyz);
        let bits = spread(min(cells, vec3<u32>(MORTON_CELLS - 1u)));
        key = bits.x | (bits.y << 1u) | (bits.z << 2u);
    }
    keys[gaussian] = key;
    gaussian_from_rank[gaussian] = gaussian;
}
