//! stub
mod render;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    if args[1] == "pic" {
        let t=std::time::Instant::now();
        let map = surefoot_world::Map::generate(&surefoot_world::MapSpec::new(args[2].parse().unwrap())).unwrap();
        println!("{:?} pads {}", t.elapsed(), map.pads().len());
        render::Picture::top_view(&map, 3.0).save(std::path::Path::new(&args[3])).unwrap(); return;
    }
    let stop = std::sync::atomic::AtomicBool::new(false);
    let config = surefoot_agent::train::TrainConfig::default();
    let r = surefoot_agent::train::run(config, std::path::Path::new(&args[1]), args.get(2).map(String::as_str)==Some("resume"), &stop, |line| println!("{line}"));
    println!("{r:?}");
}
