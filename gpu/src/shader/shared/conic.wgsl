/// xx, xy, yy: the power of two falls by xx dx^2 + xy dx dy + yy dy^2 at an offset from the centre.
fn conic_of_splat(splat: Splat) -> vec3<f32> {
    let first = splat.place.z;
    let lean = splat.place.w;
    let second = splat.form.x;
    return vec3<f32>(first + second * lean * lean, -2.0 * second * lean, second);
}
