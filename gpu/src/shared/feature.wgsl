/// A row of a Gaussian's feature; the colour head's fourth channel is depth.
fn feature_of(gaussian: u32, row: u32, depth: f32) -> vec4<f32> {
    let feature = features[gaussian * ROWS + row];
    if DEPTH { return vec4<f32>(feature.xyz, depth); }
    return feature;
}
