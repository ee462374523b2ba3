//! Plots of evaluations as SVG.

use anyhow::anyhow;
use plotters::prelude::*;
use std::path::Path;
use surefoot_agent::eval::suite::{PAPER, SuiteReport};

const SIZE: (u32, u32) = (900, 480);
const COLOURS: [RGBColor; 6] = [
    RGBColor(31, 119, 180),
    RGBColor(214, 39, 40),
    RGBColor(44, 160, 44),
    RGBColor(148, 103, 189),
    RGBColor(255, 127, 14),
    RGBColor(90, 90, 90),
];

/// Success by straight-line distance, one line for each row; bins of fewer than 30 goals are left out.
pub fn success_by_distance(report: &SuiteReport, path: &Path) -> anyhow::Result<()> {
    const FEWEST: usize = 30;
    let lines: Vec<(&str, Vec<(f32, f64)>)> = report
        .rows
        .iter()
        .map(|row| {
            let points = row.by_distance.iter().filter(|(_, rate)| rate.n >= FEWEST);
            (row.name.as_str(), points.map(|(far, rate)| (far - 12.5, 100.0 * rate.rate)).collect())
        })
        .collect();
    let farthest = lines.iter().flat_map(|(_, points)| points).map(|point| point.0).fold(25.0, f32::max);
    draw(path, |area| {
        let mut chart = ChartBuilder::on(area)
            .caption("Success by distance of the goal", ("sans-serif", 20))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(48)
            .build_cartesian_2d(0.0..farthest, 0.0..100.0)?;
        chart.configure_mesh().x_desc("straight-line distance, m").y_desc("success, %").draw()?;
        for ((name, points), colour) in lines.iter().zip(COLOURS.iter().cycle()) {
            let style = colour.stroke_width(2);
            chart
                .draw_series(LineSeries::new(points.iter().copied(), style).point_size(3))?
                .label(*name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
        }
        let position = SeriesLabelPosition::LowerLeft;
        chart.configure_series_labels().position(position).background_style(WHITE).border_style(BLACK).draw()?;
        Ok(())
    })
}

/// Success on training, validation and test maps, a group of bars for each model, with the paper's figure on test maps.
pub fn generalisation(report: &SuiteReport, path: &Path) -> anyhow::Result<()> {
    let groups = &report.generalisation;
    let splits = groups.first().map_or(0, |group| group.splits.len());
    draw(path, |area| {
        let width = (splits + 2) as f64;
        let mut chart = ChartBuilder::on(area)
            .caption("Success on maps of each split", ("sans-serif", 20))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(48)
            .build_cartesian_2d(0.0..width * groups.len() as f64, 0.0..100.0)?;
        let names: Vec<&str> = groups.iter().map(|group| group.name.as_str()).collect();
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
                Rectangle::new([(left, 0.0), (left + 0.9, 100.0 * figures.splits[split].1.rate)], colour.filled())
            });
            chart
                .draw_series(bars)?
                .label(groups[0].splits[split].0.as_str())
                .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], colour.filled()));
        }
        let papers = groups.iter().enumerate().filter_map(|(group, figures)| {
            let paper = PAPER.iter().find(|paper| paper.name == figures.name)?;
            let left = group as f64 * width + splits as f64 - 0.5;
            Some(PathElement::new([(left, 100.0 * paper.all), (left + 0.9, 100.0 * paper.all)], BLACK.stroke_width(3)))
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

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

fn draw(path: &Path, fill: impl FnOnce(&Area<'_>) -> Result<(), Box<dyn std::error::Error>>) -> anyhow::Result<()> {
    let failed = |error: &dyn std::fmt::Display| anyhow!("cannot draw {}: {error}", path.display());
    let area = SVGBackend::new(path, SIZE).into_drawing_area();
    area.fill(&WHITE).map_err(|error| failed(&error))?;
    fill(&area).map_err(|error| failed(&error))?;
    area.present().map_err(|error| failed(&error))
}
