// first |exp(a) rgb + b - target| + second |D - D_gt| of a pixel, and its gradient. A target is a
// byte for each of r, g, b and for whether there is a color, and the depth's bits; a negative depth
// is no measurement.
//
// A thread takes one row of pixels of one tile and leaves the sum of their terms. Rows of a tile that
// is left out have terms of 0, and their gradients are not written.

@group(0) @binding(0) var<uniform> arguments: LossArguments;
@group(0) @binding(1) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> target_: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> left_out: array<u32>;
@group(0) @binding(4) var<storage, read_write> gradients: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> terms: array<vec4<f32>>;

/// Writes the gradient of a pixel and returns its terms: color, depth, dL/da, dL/db.
fn compare(pixel: u32) -> vec4<f32> {
    let packed = target_[pixel];
    let color = unpack4x8unorm(packed.x);
    let wanted = vec4<f32>(color.xyz, bitcast<f32>(packed.y));
    let gain = vec4<f32>(vec3<f32>(exp(arguments.exposure.x)), 1.0);
    let exposed = gain * image[pixel];
    let off = exposed + vec4<f32>(vec3<f32>(arguments.exposure.y), 0.0) - wanted;
    let factor = vec4<f32>(vec3<f32>(arguments.first), arguments.second);
    let valid = vec4<f32>(vec3<f32>(color.w - 0.5), wanted.w) >= vec4<f32>(0.0);
    let used = select(vec4<f32>(0.0), factor, valid);
    let d_off = used * sign(off);
    gradients[pixel] = gain * d_off;
    let term = used * abs(off);
    return vec4<f32>(term.x + term.y + term.z, term.w, dot(d_off.xyz, exposed.xyz),
        d_off.x + d_off.y + d_off.z);
}

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let strip = linear_thread(group, groups, lane);
    let tile = strip / TILE_HEIGHT;
    if tile >= arguments.tiles.x * arguments.tiles.y { return; }
    let y = tile / arguments.tiles.x * TILE_HEIGHT + strip % TILE_HEIGHT;
    let first = tile % arguments.tiles.x * TILE_WIDTH;
    var sum = vec4<f32>(0.0);
    if y < arguments.size.y && left_out[tile] == 0u {
        for (var x = first; x < min(first + TILE_WIDTH, arguments.size.x); x++) {
            sum += compare(y * arguments.size.x + x);
        }
    }
    terms[strip] = sum;
}
