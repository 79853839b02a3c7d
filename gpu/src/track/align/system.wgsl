// A Gauss-Newton normal system over live pixels; each thread sums SYSTEM_RUN of them.
//
// A live pixel with depth is the point q = T p in the reference camera, seen at pi(q).
//   r_p = I_ref(pi(q)) - (e^a I_live + b)      J = [s, q x s, -e^a I_live, -1], s = dI_ref/dq
//   r_g = n_ref . (q - p_ref)                  J = [n, q x n, 0, 0]
// The weight of r_g is 1 / (1 / weight + (depth_noise q.z^2)^2).
// Both only where the point is on the reference's surface: within the gate of the plane of p_ref, and
// facing as that does. There is no plane at an edge of depth, where pixels show both sides.
// I_ref and its slopes are interpolated between four pixels; p_ref and n_ref are the nearest's.
// T <- Exp(tau) T, tau = [rho, theta]: dq/drho = 1, dq/dtheta = -[q]x.
// With weight w = (term's weight) rho'(r) / r:  H += w J J^T,  g += w r J,  cost += weight rho(r).

@group(0) @binding(0) var<uniform> arguments: AlignArguments;
@group(0) @binding(1) var<storage, read> reference_colors: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> reference_surface: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> live_colors: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> live_surface: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> partials: array<vec4<f32>>;

/// Upper triangle of H row by row, g, costs and counts.
alias Sums = array<vec4<f32>, SYSTEM_ROWS>;

/// A weighted residual with its derivative by [rho, theta] and [a, b].
struct Term {
    weight: f32,
    cost: f32,
    residual: f32,
    first: vec4<f32>,
    last: vec4<f32>,
    used: f32,
    inlier: f32,
}

fn huber(residual: f32, threshold: f32) -> vec2<f32> {
    let size = abs(residual);
    let near = min(size, threshold);
    return vec2<f32>(threshold / max(size, threshold), near * (size - 0.5 * near));
}

fn cauchy(residual: f32, threshold: f32) -> vec2<f32> {
    let scaled = residual / threshold;
    let growth = 1.0 + scaled * scaled;
    return vec2<f32>(1.0 / growth, 0.5 * threshold * threshold * log(growth));
}

fn geometric_robust(residual: f32) -> vec2<f32> {
    if CAUCHY { return cauchy(residual, arguments.thresholds.y); }
    return huber(residual, arguments.thresholds.y);
}

/// A term from its residual, its slope with respect to q, and its weight and cost per unit.
fn term(residual: f32, q: vec3<f32>, slope: vec3<f32>, exposure: vec2<f32>, robust: vec2<f32>,
        limits: vec2<f32>, accepted: bool) -> Term {
    let turn = cross(q, slope);
    let weight = select(0.0, limits.x, accepted);
    return Term(
        weight * robust.x,
        weight * robust.y,
        residual,
        vec4<f32>(slope, turn.x),
        vec4<f32>(turn.yz, exposure),
        select(0.0, 1.0, accepted),
        select(0.0, 1.0, accepted && abs(residual) <= limits.y),
    );
}

fn add(sums: ptr<function, Sums>, t: Term) {
    let a = t.first;
    let b = t.last;
    let wa = t.weight * a;
    let wb = t.weight * b;
    (*sums)[0] += wa.x * a;
    (*sums)[1] += wa.x * b;
    (*sums)[2] += wa.y * vec4<f32>(a.yzw, b.x);
    (*sums)[3] += vec4<f32>(wa.y * b.yzw, wa.z * a.z);
    (*sums)[4] += wa.z * vec4<f32>(a.w, b.xyz);
    (*sums)[5] += vec4<f32>(wa.z * b.w, wa.w * a.w, wa.w * b.xy);
    (*sums)[6] += vec4<f32>(wa.w * b.zw, wb.x * b.xy);
    (*sums)[7] += vec4<f32>(wb.x * b.zw, wb.y * b.yz);
    (*sums)[8] += vec4<f32>(wb.y * b.w, wb.z * b.zw, wb.w * b.w);
    (*sums)[9] += t.residual * wa;
    (*sums)[10] += t.residual * wb;
}

/// Adds the live pixel (x, y) to the sums.
fn visit(sums: ptr<function, Sums>, here: vec2<u32>, counted: bool) {
    let pixel = here.y * arguments.live_size.x + here.x;
    let seen = bitcast<f32>(live_colors[pixel].x);
    let own_surface = live_surface[pixel];
    let z = bitcast<f32>(own_surface.x);
    let is_live = counted && z > 0.0 && z < FAR;
    let ray = (vec2<f32>(here) - arguments.live.zw) / arguments.live.xy;
    let p = vec4<f32>(ray * z, z, 1.0);
    let moved = vec3<f32>(dot(arguments.pose_x, p), dot(arguments.pose_y, p),
        dot(arguments.pose_z, p));
    let in_front = is_live && moved.z > NEAR;
    let q = select(vec3<f32>(0.0, 0.0, 1.0), moved, in_front);

    let focal = arguments.reference.xy;
    let inverse = 1.0 / q.z;
    let at = focal * (q.xy * inverse) + arguments.reference.zw;
    let size = arguments.reference_size;
    let border = vec2<f32>(size - vec2<u32>(1u));
    let inside = in_front && all(at >= vec2<f32>(0.0)) && all(at <= border);
    let place = clamp(at, vec2<f32>(0.0), border);
    let corner = min(vec2<u32>(place), size - vec2<u32>(2u));
    let part = place - vec2<f32>(corner);
    let first = corner.y * size.x + corner.x;
    let a = color(reference_colors[first]);
    let b = color(reference_colors[first + 1u]);
    let c = color(reference_colors[first + size.x]);
    let d = color(reference_colors[first + size.x + 1u]);
    let step = select(vec2<u32>(0u), vec2<u32>(1u), part >= vec2<f32>(0.5));
    let nearest = reference_surface[first + step.x + step.y * size.x];
    let depth = bitcast<f32>(nearest.x);
    let anchor = vec2<f32>(corner + step) - arguments.reference.zw;
    let plane = normal(nearest.y);
    let off = dot(plane.xyz, q - depth * vec3<f32>(anchor / focal, 1.0));
    let own = normal(own_surface.y).xyz;
    let turned = vec3<f32>(dot(arguments.pose_x.xyz, own), dot(arguments.pose_y.xyz, own),
        dot(arguments.pose_z.xyz, own));
    let noise = arguments.gates.z * q.z * q.z;
    let gate = arguments.gates.x + GATE_SIGMAS * noise;
    let has_plane = inside && depth > 0.0 && plane.w > 0.0;
    let same = has_plane && abs(off) <= gate
        && dot(turned, plane.xyz) >= arguments.gates.y;

    let mixed = mix(mix(a, b, part.x), mix(c, d, part.x), part.y);
    let gain = arguments.exposure.x * seen;
    let change = mixed.x - gain - arguments.exposure.y;
    let scaled = focal * mixed.yz * inverse;
    let bright = min(min(a.x, b.x), min(c.x, d.x)) >= 0.0 && seen >= 0.0;
    let photometric = term(change, q, vec3<f32>(scaled, -dot(scaled, q.xy) * inverse),
        vec2<f32>(-gain, -1.0), huber(change, arguments.thresholds.x),
        vec2<f32>(arguments.weights.x, arguments.thresholds.z),
        same && bright);

    let certain = arguments.weights.y / (1.0 + arguments.weights.y * noise * noise);
    let geometric = term(off, q, plane.xyz, vec2<f32>(0.0), geometric_robust(off),
        vec2<f32>(certain, arguments.thresholds.w),
        same);

    add(sums, photometric);
    add(sums, geometric);
    (*sums)[11] += vec4<f32>(photometric.cost, geometric.cost, select(0.0, 1.0, is_live),
        select(0.0, 1.0, inside));
    (*sums)[12] += vec4<f32>(photometric.used, geometric.used, photometric.inlier,
        geometric.inlier);
    // A point far behind the reference's surface is hidden there, which says nothing.
    let visible = has_plane && off >= -gate && dot(own, own) > 0.0;
    let meets = visible && off <= gate;
    let agrees = meets && (abs(change) <= arguments.thresholds.z || !bright);
    (*sums)[13] += vec4<f32>(select(0.0, 1.0, visible), select(0.0, 1.0, agrees), select(0.0, 1.0, meets), 0.0);
}

/// Element i looks at one pixel of the run [i stride, (i + 1) stride), scattered but fixed. A thread without
/// pixels writes zeros.
@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let workgroup = linear_group(group, groups);
    let width = arguments.live_size.x;
    let stride = arguments.stride;
    let first = workgroup * GROUP * SYSTEM_RUN + lane;
    if workgroup >= arguments.groups { return; }
    let phase = u32(arguments.gates.w * 65536.0);
    var sums = Sums();
    var start = vec2<u32>(first * stride % width, first * stride / width);
    let jump = vec2<u32>(GROUP * stride % width, GROUP * stride / width);
    for (var k = 0u; k < SYSTEM_RUN; k++) {
        let i = first + k * GROUP;
        let counted = i < arguments.count;
        let shift = ((((i * 2654435769u) >> 16u) + phase) % 65536u * stride) >> 16u;
        var here = start + vec2<u32>(shift, 0u);
        here = select(here, vec2<u32>(here.x - width, here.y + 1u), here.x >= width);
        visit(&sums, select(vec2<u32>(0u), here, counted), counted);
        start += jump;
        start = select(start, vec2<u32>(start.x - width, start.y + 1u), start.x >= width);
    }
    let slot = ((arguments.first_group + workgroup) * GROUP + lane) * SYSTEM_ROWS;
//repeat ROW ROWS
    partials[slot + $ROW] = sums[$ROW];
//end
}
