import sys; sys.path.insert(0,"/tmp/e")
from h import *
N=int(sys.argv[2])
for cell in sys.argv[1].split(","):
    ps=plants(cell,N,seed=int(os.environ.get("PSEED",94000)))
    for kw in eval(sys.argv[3]):
        p=params("stones",**kw); res=walk(ps,p,seed=5)
        show(cell+str(kw),res); print(sorted(s for o,s,_ in res if o!="walked"))
