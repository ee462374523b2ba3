//! Plots of results as SVG. Every plot takes plain numbers; the caller knows what they were measured on. A plot fails
//! if its file cannot be written.

use crate::ReportError;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use std::collections::BTreeSet;
use std::path::Path;

const SIZE: (u32, u32) = (900, 480);
const COLOURS: [RGBColor; 11] = [
    RGBColor(31, 119, 180),
    RGBColor(214, 39, 40),
    RGBColor(44, 160, 44),
    RGBColor(148, 103, 189),
    RGBColor(255, 127, 14),
    RGBColor(90, 90, 90),
    RGBColor(23, 190, 207),
    RGBColor(188, 189, 34),
    RGBColor(227, 119, 194),
    RGBColor(140, 86, 75),
    RGBColor(0, 0, 0),
];

/// Attempts whose distance lies between the upper end of the previous bin and that of this bin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistanceBin {
    /// Upper end of the bin, m.
    pub far_m: f32,
    /// Share of attempts that succeeded, in [0, 1].
    pub rate: f64,
    /// Its 95 % interval.
    pub interval: [f64; 2],
    /// Number of attempts.
    pub count: usize,
}

/// Plots success by straight-line distance, with one line for each named list of bins. A point is `middle_m` metres
/// below the upper end of its bin, with its interval as a vertical bar; bins with fewer than 30 attempts are omitted.
pub fn success_by_distance(rows: &[(&str, Vec<DistanceBin>)], middle_m: f32, path: &Path) -> Result<(), ReportError> {
    const FEWEST: usize = 30;
    let middle = |bin: &DistanceBin| f64::from(bin.far_m - middle_m);
    let kept = |bins: &[DistanceBin]| bins.iter().copied().filter(|bin| bin.count >= FEWEST).collect::<Vec<_>>();
    let rows: Vec<(&str, Vec<DistanceBin>)> = rows.iter().map(|(name, bins)| (*name, kept(bins))).collect();
    let points = |bins: &[DistanceBin]| bins.iter().map(|bin| (middle(bin), 100.0 * bin.rate)).collect();
    let lines: Vec<Line<'_>> = rows.iter().map(|(name, bins)| (*name, points(bins))).collect();
    // The bars of different lines are shifted, so that they do not cover one another.
    let aside = |line: usize| (line as f64 - 0.5 * rows.len() as f64) * 0.06 * f64::from(middle_m);
    let farthest = farthest_of(&lines).max(25.0);
    let axes = Axes { x: "straight-line distance, m", y: "success, %", x_end: farthest, y_end: 100.0 };
    draw_lines("Success by distance of the goal", (axes, SeriesLabelPosition::LowerLeft), &lines, path, |chart| {
        for ((line, (_, bins)), colour) in rows.iter().enumerate().zip(COLOURS.iter().cycle()) {
            chart.draw_series(bins.iter().map(|bin| {
                let (x, [low, high]) = (middle(bin) + aside(line), bin.interval.map(|share| 100.0 * share));
                PathElement::new([(x, low), (x, high)], colour.stroke_width(1))
            }))?;
        }
        Ok(())
    })
}

/// Plots tick times, ms, by number of NPCs, with the limit that they should stay below.
pub fn tick_times(mut lines: Vec<Line<'_>>, limit_ms: f64, path: &Path) -> Result<(), ReportError> {
    let most = 1.05 * farthest_of(&lines);
    let longest = lines.iter().flat_map(|(_, points)| points).map(|point| point.1).fold(limit_ms, f64::max);
    lines.push(("limit", vec![(0.0, limit_ms), (most, limit_ms)]));
    let axes = Axes { x: "NPCs", y: "ms", x_end: most, y_end: 1.1 * longest };
    let caption = "From when a tick is due until it is done, worst of the worlds";
    draw_lines(caption, (axes, SeriesLabelPosition::UpperLeft), &lines, path, |_| Ok(()))
}

/// The name and the points (x, y) of a line.
pub type Line<'a> = (&'a str, Vec<(f64, f64)>);

/// Labels and upper ends of the axes, which start at 0.
struct Axes {
    x: &'static str,
    y: &'static str,
    x_end: f64,
    y_end: f64,
}

fn farthest_of(lines: &[Line<'_>]) -> f64 {
    lines.iter().flat_map(|(_, points)| points).map(|point| point.0).fold(0.0, f64::max)
}

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn = Result<(), Box<dyn std::error::Error>>;

/// Plots lines, and `marks` over them.
fn draw_lines(
    caption: &str,
    (axes, legend): (Axes, SeriesLabelPosition),
    lines: &[Line<'_>],
    path: &Path,
    marks: impl FnOnce(&mut Chart<'_, '_>) -> Drawn,
) -> Result<(), ReportError> {
    draw(path, |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(caption, ("sans-serif", 20))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(56)
            .build_cartesian_2d(0.0..axes.x_end, 0.0..axes.y_end)?;
        chart.configure_mesh().x_desc(axes.x).y_desc(axes.y).draw()?;
        for ((name, points), colour) in lines.iter().zip(COLOURS.iter().cycle()) {
            let style = colour.stroke_width(2);
            chart
                .draw_series(LineSeries::new(points.iter().copied(), style).point_size(3))?
                .label(*name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
        }
        marks(&mut chart)?;
        chart.configure_series_labels().position(legend).background_style(WHITE).border_style(BLACK).draw()?;
        Ok(())
    })
}

/// Success of one model on several splits of maps.
#[derive(Debug, Clone, PartialEq)]
pub struct BarGroup<'a> {
    /// Name of the model.
    pub name: &'a str,
    /// Name of each split and share of attempts that succeeded on it, in [0, 1]; every group has the same splits.
    pub bars: Vec<(&'a str, f64)>,
    /// Success on test maps in the paper, in [0, 1], if the paper reports it.
    pub paper: Option<f64>,
}

/// Plots success on the splits of maps, with a group of bars for each model and the paper's result on test maps.
pub fn generalisation(groups: &[BarGroup<'_>], path: &Path) -> Result<(), ReportError> {
    let splits = groups.first().map_or(0, |group| group.bars.len());
    draw(path, |area| {
        let width = (splits + 2) as f64;
        let mut chart = ChartBuilder::on(area)
            .caption("Success on maps of each split", ("sans-serif", 20))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(48)
            .build_cartesian_2d(0.0..width * groups.len() as f64, 0.0..100.0)?;
        let names: Vec<&str> = groups.iter().map(|group| group.name).collect();
        chart
            .configure_mesh()
            .disable_x_mesh()
            .x_labels(1)
            .x_label_formatter(&|_| String::new())
            .x_desc(names.join("   |   "))
            .y_desc("success, %")
            .draw()?;
        for (split, &colour) in COLOURS.iter().enumerate().take(splits) {
            let bars = groups.iter().enumerate().map(|(group, figures)| {
                let left = group as f64 * width + split as f64 + 0.5;
                Rectangle::new([(left, 0.0), (left + 0.9, 100.0 * figures.bars[split].1)], colour.filled())
            });
            chart
                .draw_series(bars)?
                .label(groups[0].bars[split].0)
                .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], colour.filled()));
        }
        let papers = groups.iter().enumerate().filter_map(|(group, figures)| {
            let paper = figures.paper?;
            let left = group as f64 * width + splits as f64 - 0.5;
            Some(PathElement::new([(left, 100.0 * paper), (left + 0.9, 100.0 * paper)], BLACK.stroke_width(3)))
        });
        chart
            .draw_series(papers)?
            .label("the paper, test maps")
            .legend(|(x, y)| PathElement::new([(x, y), (x + 14, y)], BLACK.stroke_width(3)));
        let position = SeriesLabelPosition::LowerMiddle;
        chart.configure_series_labels().position(position).background_style(WHITE).border_style(BLACK).draw()?;
        Ok(())
    })
}

/// Ranges of one row of a plot of ranges.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeRow<'a> {
    /// Name of the row.
    pub name: &'a str,
    /// For each series: lower bound, mean and upper bound.
    pub ranges: Vec<[f64; 3]>,
}

/// What a plot of ranges shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeAxes<'a> {
    /// Caption.
    pub title: &'a str,
    /// Name and unit of the values.
    pub x: &'a str,
    /// Name of each series.
    pub series: &'a [&'a str],
}

/// Plots a mean with its interval for each row and series, the first row on top.
pub fn ranges(axes: RangeAxes<'_>, rows: &[RangeRow<'_>], path: &Path) -> Result<(), ReportError> {
    const ROW_HEIGHT: u32 = 34;
    const LABELS_WIDTH: u32 = 330;
    /// Empty rows at the bottom, so that the legend covers nothing.
    const LEGEND_ROWS: u32 = 2;
    let values = || rows.iter().flat_map(|row| row.ranges.iter().flatten().copied());
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    if rows.is_empty() || !(low.is_finite() && high.is_finite()) {
        return Err(ReportError::Draw(path.to_owned(), "there is nothing to draw".to_owned()));
    }
    let margin = 0.05 * (high - low).max(1.0);
    let count = rows.len() as f64;
    let size = (SIZE.0, 110 + ROW_HEIGHT * (rows.len() as u32 + LEGEND_ROWS));
    draw_sized(path, size, |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(axes.title, ("sans-serif", 20))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(LABELS_WIDTH)
            .build_cartesian_2d(low - margin..high + margin, (-f64::from(LEGEND_ROWS)..count).step(1.0))?;
        // A label stands in the middle of its row.
        let label = |y: &f64| rows.get((count - y - 0.5).round() as usize).map_or("", |row| row.name).to_owned();
        chart
            .configure_mesh()
            .disable_y_mesh()
            .y_labels(rows.len() + LEGEND_ROWS as usize + 1)
            .y_label_offset(-(ROW_HEIGHT as i32) / 2)
            .y_label_formatter(&|y| label(&(y + 0.5)))
            .x_desc(axes.x)
            .draw()?;
        for (idx, (name, &colour)) in axes.series.iter().zip(COLOURS.iter()).enumerate() {
            let share = (idx as f64 + 1.0) / (axes.series.len() as f64 + 1.0);
            let drawn = rows
                .iter()
                .enumerate()
                .filter_map(|(row, it)| Some((count - row as f64 - share, *it.ranges.get(idx)?)));
            let (bars, points): (Vec<_>, Vec<_>) = drawn
                .map(|(y, [low, mean, high])| {
                    let bar = PathElement::new([(low, y), (high, y)], colour.stroke_width(2));
                    (bar, Circle::new((mean, y), 4, colour.filled()))
                })
                .unzip();
            chart.draw_series(bars)?;
            chart.draw_series(points)?.label(*name).legend(move |(x, y)| Circle::new((x + 9, y), 4, colour.filled()));
        }
        let position = SeriesLabelPosition::LowerLeft;
        chart.configure_series_labels().position(position).background_style(WHITE).border_style(BLACK).draw()?;
        Ok(())
    })
}

/// Results of graphs of one size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SizeOutcome {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of neighbours to which each vertex had candidate edges.
    pub neighbours: usize,
    /// Share of attempts that succeeded, in [0, 1].
    pub rate: f64,
    /// Time to build the graph and to run all attempts, s.
    pub total_s: f64,
    /// Median duration of a search, us.
    pub search_us: f64,
}

/// The distinct values of `size` among `outcomes`, ascending.
fn sizes(outcomes: &[SizeOutcome], size: impl Fn(&SizeOutcome) -> usize) -> Vec<usize> {
    outcomes.iter().map(size).collect::<BTreeSet<_>>().into_iter().collect()
}

/// Plots a heat map of success by numbers of vertices and neighbours.
pub fn sweep(outcomes: &[SizeOutcome], path: &Path) -> Result<(), ReportError> {
    let rates = || outcomes.iter().map(|outcome| 100.0 * outcome.rate);
    let (low, high) = (rates().fold(100.0, f64::min), rates().fold(0.0, f64::max));
    let vertices = sizes(outcomes, |outcome| outcome.vertices);
    let neighbours = sizes(outcomes, |outcome| outcome.neighbours);
    let place = |list: &[usize], value: usize| list.iter().position(|&other| other == value).unwrap_or(0) as f64;
    draw(path, |area| {
        let (columns, rows) = (vertices.len() as f64, neighbours.len() as f64);
        let mut chart = ChartBuilder::on(area)
            .caption("Success in % by vertices (across) and neighbours (up)", ("sans-serif", 20))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(48)
            .build_cartesian_2d(0.0..columns, 0.0..rows)?;
        chart
            .configure_mesh()
            .disable_mesh()
            .x_labels(0)
            .y_labels(0)
            .x_desc(format!("vertices: {vertices:?}"))
            .y_desc(format!("neighbours: {neighbours:?}"))
            .draw()?;
        for outcome in outcomes {
            let (x, y) = (place(&vertices, outcome.vertices), place(&neighbours, outcome.neighbours));
            let rate = 100.0 * outcome.rate;
            let warmth = (rate - low) / (high - low).max(1.0e-9);
            let colour = RGBColor((230.0 - 170.0 * warmth) as u8, (110.0 + 90.0 * warmth) as u8, 90);
            chart.draw_series([Rectangle::new([(x, y), (x + 1.0, y + 1.0)], colour.filled())])?;
            let style = ("sans-serif", 20).into_font().color(&BLACK);
            chart.draw_series([Text::new(format!("{rate:.1}"), (x + 0.38, y + 0.56), style)])?;
        }
        Ok(())
    })
}

/// Plots build and search times by number of vertices, with one line for each number of neighbours.
pub fn run_time(outcomes: &[SizeOutcome], path: &Path) -> Result<(), ReportError> {
    let most = outcomes.iter().map(|outcome| outcome.total_s).fold(1.0, f64::max);
    let widest = outcomes.iter().map(|outcome| outcome.vertices).max().unwrap_or(1) as f64;
    let of_line = |count: usize| outcomes.iter().filter(move |outcome| outcome.neighbours == count);
    let at = |outcome: &SizeOutcome| (outcome.vertices as f64, outcome.total_s);
    let neighbours = sizes(outcomes, |outcome| outcome.neighbours);
    let names: Vec<String> = neighbours.iter().map(|count| format!("{count} neighbours")).collect();
    let points = neighbours.iter().map(|&count| of_line(count).map(at).collect());
    let lines: Vec<Line<'_>> = names.iter().map(String::as_str).zip(points).collect();
    let caption = "Build and evaluation per map (lines), search (at the points)";
    let axes = Axes { x: "vertices", y: "seconds", x_end: widest * 1.1, y_end: most * 1.1 };
    draw_lines(caption, (axes, SeriesLabelPosition::UpperLeft), &lines, path, |chart| {
        for (&count, colour) in neighbours.iter().zip(COLOURS.iter().cycle()) {
            let font = ("sans-serif", 12).into_font().color(colour);
            let text =
                |outcome: &SizeOutcome| Text::new(format!("{:.1} us", outcome.search_us), at(outcome), font.clone());
            chart.draw_series(of_line(count).map(text))?;
        }
        Ok(())
    })
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

fn draw(path: &Path, fill: impl FnOnce(&Area<'_>) -> Drawn) -> Result<(), ReportError> {
    draw_sized(path, SIZE, fill)
}

fn draw_sized(path: &Path, size: (u32, u32), fill: impl FnOnce(&Area<'_>) -> Drawn) -> Result<(), ReportError> {
    let failed = |error: &dyn std::fmt::Display| ReportError::Draw(path.to_owned(), error.to_string());
    let area = SVGBackend::new(path, size).into_drawing_area();
    area.fill(&WHITE).map_err(|error| failed(&error))?;
    fill(&area).map_err(|error| failed(&error))?;
    area.present().map_err(|error| failed(&error))
}
