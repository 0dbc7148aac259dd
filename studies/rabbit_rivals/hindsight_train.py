"""python hs_train.py SEED TICKS OUT: a student of hindsight; families left out: LEFT_OUT."""
import sys, time, json, csv, math
from pathlib import Path
import numpy as np, torch
from torch import nn
import rabbit_rivals.hindsight as H
import rabbit_rivals.plants as P
from rabbit_benchmark.families import families
from rl_cbf_clf_controller.network import Actor
from rabbit_rivals.joint_targets import NetworkAbout, READS, ACTIONS
from rabbit_rivals.model_file import ModelFile
LEFT_OUT={"gusts","stuck-encoders","tipping-stones","weak-motors"}
known=families().families
class Fam:  # training never draws these
    families={k:v for k,v in known.items() if k not in LEFT_OUT}
P.families=lambda: Fam
seed,ticks,out=int(sys.argv[1]),int(sys.argv[2]),Path(sys.argv[3]); out.mkdir(parents=True,exist_ok=True)
plants=int(sys.argv[4]) if len(sys.argv)>4 else 40
torch.set_num_threads(1); torch.manual_seed(seed)
rng=np.random.default_rng([seed,7])
net=nn.Sequential(nn.Linear(READS,256),nn.ReLU(),nn.Linear(256,256),nn.ReLU(),nn.Linear(256,ACTIONS),nn.Tanh())
with torch.no_grad():
    for p in net[4].parameters(): p.mul_(0.05)
opt=torch.optim.Adam(net.parameters(),lr=5e-4)
def arrays(): 
    return {f"{i}.{n}":v.detach().numpy().copy() for i,l in enumerate(net[::2]) for n,v in l.named_parameters()}
CAP=500_000
X=np.empty((CAP,READS),np.float32); Y=np.empty((CAP,ACTIONS),np.float32); n=total=0
walked=0; latest={"stones":0.0,"flat":0.0}; rounds=0; t0=time.time()
hours=0.0; marks=[ticks*k//5 for k in range(1,6)]
with (out/"curve.csv").open("w") as f: f.write("ticks,seconds,terrain,latest,plants,walked,stood,lessons,loss,"+",".join(c.replace(",",";") for c in H.CANDIDATES)+"\n")
def keep(name):
    about=NetworkAbout(learner="hindsight",hidden=(256,256),ticks=walked,hours=round((time.time()-t0)/3600,3),seed=seed,command="hs_train")
    ModelFile(about,arrays()).write(out/name)
while walked<ticks:
    terrain="flat" if rounds%4==3 else "stones"; rounds+=1
    act=Actor(arrays())
    r=H.walk_round(terrain,plants,act,int(latest[terrain]),rng)
    walked+=r.ticks
    share=r.stood/r.plants
    latest[terrain]=min(350,max(20,latest[terrain]*1.5)) if share>0.85 else max(0,latest[terrain]*0.8)
    m=len(r.reads); total+=m
    room=min(m,CAP-n); X[n:n+room],Y[n:n+room]=r.reads[:room],r.actions[:room]; n+=room
    if m>room:
        at=rng.choice(CAP,m-room,replace=False); X[at],Y[at]=r.reads[room:],r.actions[room:]
    loss=0.0; steps=max(1,r.ticks//128)
    for _ in range(steps):
        at=rng.integers(n,size=512)
        e=(net(torch.from_numpy(X[at]))-torch.from_numpy(Y[at])).square().mean()
        opt.zero_grad(); e.backward(); opt.step(); loss+=e.item()/steps
    with (out/"curve.csv").open("a") as f: f.write(f"{walked},{time.time()-t0:.0f},{terrain},{latest[terrain]:.0f},{r.plants},{r.walked},{r.stood},{m},{loss:.5f},"+",".join(map(str,r.teachers))+"\n")
    while marks and walked>=marks[0]: keep(f"policy-{marks.pop(0)}.safetensors")
keep("policy.safetensors")
