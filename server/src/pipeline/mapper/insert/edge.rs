//! The edge through a cell of an image, from the gradients of its brightness (the structure tensor).

use super::quadtree::Cell;
use lexsplat_pictures::Grey;
use nalgebra::{Matrix2, SymmetricEigen, Vector2};

/// Gradients of this size are noise: brightness (0 to 255) per pixel.
const NOISE: f32 = 2.55;
/// Pixels around the cell that count, too.
const MARGIN: usize = 1;

/// What an edge looks like in a cell.
pub(super) struct Edge {
    /// Along the edge: a unit vector in the image, right and down.
    pub direction: Vector2<f32>,
    /// 0 where brightness changes in all directions or in none, 1 where it changes across the edge only.
    pub clarity: f32,
}

/// The edge through a cell of an image of this brightness.
pub(super) fn edge(grey: &Grey, cell: Cell) -> Edge {
    let Grey { width, height, .. } = *grey;
    let brightness = |x: usize, y: usize| grey.values[y * width + x];
    let around = |first: usize, size: usize| {
        first.saturating_sub(MARGIN)..(first + cell.side + MARGIN).min(size)
    };
    let mut tensor = Matrix2::from_diagonal_element(f32::EPSILON);
    let mut noise = 0.0;
    for y in around(cell.top, height) {
        for x in around(cell.left, width) {
            let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
            let (above, below) = (y.saturating_sub(1), (y + 1).min(height - 1));
            let across = brightness(right, y) - brightness(left, y);
            let down = brightness(x, below) - brightness(x, above);
            let gradient = Vector2::new(across, down) / 2.0;
            tensor += gradient * gradient.transpose();
            noise += NOISE * NOISE;
        }
    }
    let axes = SymmetricEigen::new(tensor);
    let strongest = axes.eigenvalues.imax();
    let [strong, weak] = [axes.eigenvalues[strongest], axes.eigenvalues[1 - strongest]];
    Edge {
        direction: axes.eigenvectors.column(1 - strongest).into_owned(),
        clarity: (strong - weak) / (strong + weak + noise),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::wall;
    use super::*;

    const CELL: Cell = Cell { left: 2, top: 2, side: 4 };

    fn found(brightness: impl Fn(usize, usize) -> u8) -> Edge {
        let mut image = wall(8);
        image.rgb = (0..8 * 8 * 3).map(|at| brightness(at / 3 % 8, at / 24)).collect();
        edge(&Grey::new(&image.picture()), CELL)
    }

    #[test]
    fn an_edge_has_its_direction() {
        let upright = found(|x, _| if x < 4 { 40 } else { 200 });
        assert!(upright.clarity > 0.95 && upright.direction.y.abs() > 0.999);
        let level = found(|_, y| if y < 4 { 40 } else { 200 });
        assert!(level.clarity > 0.95 && level.direction.x.abs() > 0.999);
        // From the upper right to the lower left.
        let slanted = found(|x, y| if x + y < 7 { 40 } else { 200 });
        let along = slanted.direction.dot(&Vector2::new(1.0, -1.0).normalize()).abs();
        assert!(slanted.clarity > 0.8 && along > 0.99, "{along}");
    }

    #[test]
    fn without_an_edge_there_is_no_clarity() {
        assert!(found(|_, _| 128).clarity < 1e-3, "flat");
        assert!(found(|x, y| 127 + ((x * 7 + y * 3) % 3) as u8).clarity < 0.1, "noise");
        let dot = found(|x, y| if (3..5).contains(&x) && (3..5).contains(&y) { 200 } else { 40 });
        assert!(dot.clarity < 0.05, "all directions: {}", dot.clarity);
    }
}
