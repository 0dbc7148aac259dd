"""hs_eval.py COURSES OUT NAME=PATH[:SHARE] ...  on the 14 families, development seed"""
import sys, json, time
from concurrent.futures import ProcessPoolExecutor
import numpy as np
def walk_cell(args):
    name,path,share,cellname,courses=args
    import hs_mod
    from rabbit_benchmark.cells import cells
    from rabbit_benchmark.protocol import Protocol
    from rabbit_benchmark.methods import method
    from dataclasses import replace
    cell=cells()[cellname]
    pr=Protocol(courses=courses,seeds="development",plant="mujoco")
    cell_courses=courses
    import rabbit_benchmark.cells as C
    class OneCell:  # exactly `courses` courses
        pass
    if path=="method": m=method(name)
    elif path.startswith("method"): m=method(name)
    else:
        if share is None:
            base=hs_mod.DAGGER
            m=replace(base,name=name,stones=replace(base.stones,policy=path),flat=replace(base.flat,policy=path))
        else:
            K=type("K"+name.replace("-","_"),(hs_mod.StudentMixed,),{"path":path,"share":share,"__module__":"hs_mod"})
            m=replace(hs_mod.Method("x","x",replace(hs_mod.BEST["stones"],kind=K),replace(hs_mod.BEST["flat"],kind=K),""),name=name)
    jobs=pr.walks(m,cell)[:courses]
    return name,cellname,[j.do().row.success for j in jobs]
if __name__=="__main__":
    courses=int(sys.argv[1]); out=sys.argv[2]; procs=int(sys.argv[3])
    from rabbit_benchmark.cells import cells
    LEFT={"gusts","stuck-encoders","tipping-stones","weak-motors"}
    names=[c.name for c in cells().values() if c.map in("reported","unseen") or c.name.split("/")[1] in LEFT]
    tasks=[]
    for a in sys.argv[4:]:
        name,_,rest=a.partition("="); path,_,share=rest.partition(":")
        for c in names: tasks.append((name,path or "method",float(share) if share else None,c,courses))
    res={}
    with ProcessPoolExecutor(procs) as ex:
        for name,c,w in ex.map(walk_cell,tasks):
            res.setdefault(name,{})[c]=[int(x) for x in w]
            json.dump(res,open(out,"w"))
    for n,d in res.items(): print(n,sum(map(sum,d.values())),"of",sum(map(len,d.values())))
