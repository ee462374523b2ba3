use surefoot_world::*;
use surefoot_world::character::*;
use rand::{SeedableRng, RngExt};
use std::sync::Arc;
use std::time::Instant;
fn main(){
  for seed in [0u64,1,1000] {
    let t=Instant::now();
    let map=Arc::new(Map::generate(&MapSpec::new(seed)).unwrap());
    println!("seed {seed} gen {:?} tris {} mem {} MB pads {} pools {} hash {}",t.elapsed(),map.mesh().triangles().len(),map.mesh().memory_bytes()/1000000,map.pads().len(),map.pools().len(),map.hash());
    let up=map.mesh().triangles().iter().filter(|t|t.normal().y>0.82).count();
    let down=map.mesh().triangles().iter().filter(|t|t.normal().y < -0.3).count();
    println!(" walkable tris {up} overhang {down}");
    let profile=CharacterProfile::default();
    let mut rng=rand::rngs::ChaCha8Rng::seed_from_u64(5);
    let t=Instant::now();
    let pts=navigable::sample_many(&map,&profile,2000,&mut rng).unwrap();
    println!(" 2000 samples {:?}",t.elapsed());
    let mut world=World::new(map.clone(),profile.clone(),TaskConfig::default());
    let n=256;
    for i in 0..n { let s=world.spawn(pts[i],rng.random_range(-3.0..3.0)); world.set_goal(s,pts[i+300]); }
    let mut row=vec![0f32;OBSERVATION_LEN];
    let (mut to,mut tt)=(0.0,0.0);
    let mut ends=std::collections::BTreeMap::new();
    let mut dec=0;
    let mut maxpen=0;
    let mut scratch=MoveScratch::default();
    for _ in 0..200 {
      let t=Instant::now();
      for i in 0..n { world.observe(NpcSlot(i as u32),&mut row); }
      to+=t.elapsed().as_secs_f64();
      for i in 0..n { let b=world.npc(NpcSlot(i as u32)).unwrap().body; let e=world.npc(NpcSlot(i as u32)).unwrap().episode.unwrap(); let l=b.to_local(e.goal-b.feet).normalize();
        let turn=if l.z<0.0 {l.x.signum()*-1.0} else {-l.x};
        world.decide(NpcSlot(i as u32),Action::from_array([0.5+l.z*0.5,rng.random_range(-0.3..0.3),turn,rng.random_range(-1.0..0.3)]).unwrap()); }
      let t=Instant::now();
      world.tick_decision();
      tt+=t.elapsed().as_secs_f64();
      dec+=n;
      for i in 0..n { let s=NpcSlot(i as u32); let o=world.close_decision(s).unwrap();
        if !is_clear(map.mesh(),&profile,world.npc(s).unwrap().body.feet,0.05,&mut scratch) {maxpen+=1;}
        if let Some(e)=o.end { *ends.entry(e.name()).or_insert(0)+=1; world.teleport(s,pts[rng.random_range(0..2000)],0.0); world.set_goal(s,pts[rng.random_range(0..2000)]); } }
    }
    println!(" observe {:.2} us ({:.3} us/ray) ticks {:.2} us per decision -> {:.0}/s ; ends {:?} pen {maxpen}/{dec}",to/dec as f64*1e6,to/dec as f64*1e6/64.0,tt/dec as f64*1e6,dec as f64/(to+tt),ends);
  }
}
