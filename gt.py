import sys; sys.path.insert(0,"/tmp/e")
from h import *
import h
N=40
ps=plants("stones/slow8",N,seed=94000)
for kw in ({"gait":"paper_stones"},{"gait":"paper_stones","stone_margin":0.01},{"gait":"paper_stones","prediction":False},{"speed_regulation":"integral"}):
    p=params("stones",**kw); res=walk(ps,p,seed=5)
    show(str(kw),res); print(sorted(s for o,s,_ in res if o!="walked"))
