import os
from dataclasses import replace
from rabbit_benchmark.methods import Method
from rabbit_reproduce.controllers import BEST
from rabbit_rivals.methods import MixedAssembly, DAGGER, JointTargetAssembly
from rabbit_rivals.mixture import MixedController
from rl_cbf_clf_controller.controller_parts import nothing_further
class Share(MixedController):
    share=0.25
    def step(self,state):
        output=super(MixedController,self).step(state)
        return replace(output,torque=(1-self.share)*output.torque+self.share*self.student.step(state).torque)
def kind(path,share):
    class A(MixedAssembly):
        pass
    A.path,A.share=path,share
    return A
class StudentMixed(MixedAssembly):
    kind=Share; path=""; share=0.25
    def make_controller(self, further=nothing_further):
        c=super(MixedAssembly,self).make_controller(further)
        s=DAGGER.on(self.controller.terrain).assembly()
        c.student=replace(s,policy=self.path).make_controller(); c.share=self.share
        return c
