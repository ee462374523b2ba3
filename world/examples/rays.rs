use surefoot_world::*;
use std::time::Instant;
use rand::{SeedableRng, RngExt};
fn main(){
    let map=Map::generate(&MapSpec::new(0)).unwrap();
    let profile=CharacterProfile::default();
    let mut rng=rand::rngs::ChaCha8Rng::seed_from_u64(5);
    let pts=navigable::sample_many(&map,&profile,256,&mut rng).unwrap();
    let cone=sense::RayCone::default();
    let mut n=0u64; let mut d=0.0; let mut hits=0;
    for _ in 0..3 { let t=Instant::now(); 
    for p in &pts { for _ in 0..20 { let b=Body::at(*p,rng.random_range(-3.0..3.0)); cone.cast(&map,&profile,&b,|_,x,_|{d+=x;hits+=1;}); n+=64; } }
    println!("{:.3} us/ray", t.elapsed().as_secs_f64()*1e6/(256.0*20.0*64.0)); }
    println!("mean hit {} hits {}",d/hits as f32,hits as f64/n as f64);
}
