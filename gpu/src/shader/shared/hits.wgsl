/// Loads the hits from `start` on, one per lane, and publishes their splats and CHUNK rows of their
/// features. Hits from `end` on get an opacity of zero.
fn publish_hits(start: u32, end: u32, lane: u32) {
    let gaussian = gaussian_from_sorted[min(start + lane % BATCH, end - 1u)];
    var form = splats[gaussian].form;
    form.y = select(-HUGE, form.y, start + lane < end);
    publish(0u, splats[gaussian].place, lane);
    publish(1u, form, lane);
    //repeat row CHUNK
    {
        let row = pass_.chunk * CHUNK + $row;
        var feature = vec4<f32>(0.0);
        if DEPTH {
            feature = splats[gaussian].feature;
        } else if row < ROWS {
            feature = features[gaussian * ROWS + row];
        }
        feature = select(vec4<f32>(0.0), feature, abs(feature) < vec4<f32>(HUGE));
        publish(2u + $row, feature, lane);
    }
    //end
}
