// source[slot] = Gaussian and marks. Whoever stays has its slot, a birth the one behind it:
// slot = kept before + births before, as far as births are allowed.

@group(0) @binding(0) var<uniform> arguments: DensifyArguments;
@group(0) @binding(1) var<storage, read> kept: array<u32>; // this and the next two: scanned
@group(0) @binding(2) var<storage, read> births: array<u32>;
@group(0) @binding(3) var<storage, read> splits: array<u32>;
@group(0) @binding(4) var<storage, read> counts: array<SurgeryCounts>;
@group(0) @binding(5) var<storage, read_write> source: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let gaussian = linear_thread(group, groups, lane);
    if gaussian >= arguments.count { return; }
    let before = kept[gaussian];
    if kept[gaussian + 1u] == before { return; }
    let born = counts[0].born;
    let slot = before + min(births[gaussian], born);
    if births[gaussian + 1u] == births[gaussian] || births[gaussian] >= born {
        source[slot] = gaussian;
        return;
    }
    let split = splits[gaussian + 1u] > splits[gaussian];
    source[slot] = gaussian | select(0u, FRESH | CHILD, split);
    source[slot + 1u] = gaussian | select(FRESH, FRESH | CHILD, split);
}
