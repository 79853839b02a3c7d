// The totals, by one thread. Births beyond max_gaussians do not happen, in the order of Gaussians:
// the last that does is followed by the first i with births before it == born.

@group(0) @binding(0) var<uniform> arguments: DensifyArguments;
@group(0) @binding(1) var<storage, read> kept: array<u32>; // this and the next two: scanned
@group(0) @binding(2) var<storage, read> births: array<u32>;
@group(0) @binding(3) var<storage, read> splits: array<u32>;
@group(0) @binding(4) var<storage, read_write> counts: array<SurgeryCounts>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    if linear_thread(group, groups, lane) > 0u { return; }
    let stay = kept[arguments.count];
    let room = arguments.max_gaussians - min(stay, arguments.max_gaussians);
    let born = min(births[arguments.count], room);
    var low = 0u;
    var high = arguments.count;
    while low < high {
        let middle = (low + high) / 2u;
        if births[middle] < born { low = middle + 1u; } else { high = middle; }
    }
    counts[0] = SurgeryCounts(stay, born, splits[low], stay + born);
}
